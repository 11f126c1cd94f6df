/* The bench `as-built` in closed loop, as one would write it in C for this bench alone: three axes with 4, 2 and 1
   modes, three actuators and three sensor heads, its effects in place, every size known to the compiler. */

#include <math.h>
#include <stdint.h>

enum { AXES = 3, MODES = 7, BLOCKS = 3 };
static const int FIRST[AXES + 1] = {0, 4, 6, 7}; /* the modes of each axis */

typedef struct {
    double a[MODES][2][2], b[MODES][2];      /* exact zero-order hold of each mode, input of its own axis */
    double c[MODES][2], rate_c[MODES][2], rate_d[AXES];
    double to_heads[AXES][3], to_reading[3][AXES], to_current[3][AXES], to_torque[AXES][3], lever[3][AXES];
    double cold_k, resistance, time_constant, steepness, dt; /* heat */
    double noise[3], bandwidth[3], limit[3]; /* amplifiers */
    double head_noise[3], apex_linear[3], apex_quadratic[3], gain[2];
    double ja[2][6], poly[2][6], trim[2], thermal[2], reference_k[2]; /* theta_x and theta_y */
    double stop_stiffness[3], stop_damping[3], gap[3];
    double fa[AXES][BLOCKS][2][2], fb[AXES][BLOCKS][2], fc[AXES][BLOCKS][2], fd[AXES]; /* feedback */
} Bench;

typedef struct {
    double x[MODES][2], xf[AXES][BLOCKS][2], past[AXES], torque[AXES], amplifier[3], iron[2][2], temperature;
} State;

static inline double least(double a, double b) { return a < b ? a : b; }

static inline double most(double a, double b) { return a > b ? a : b; }

static inline double jiles_atherton(const double *restrict p, double *restrict s, double position)
{
    double change = position - s[0];
    if (change == 0.0)
        return p[0] * s[1];
    int rising = change > 0.0;
    double widest = 0.05 * least(p[2], p[1]), per_a = 1.0 / p[1];
    double alpha = p[4], saturation = p[5];
    int parts = fabs(change) <= widest ? 1 : (int)ceil(least(fabs(change) / widest, 200.0));
    double dh = parts == 1 ? change : change / parts, h = s[0], m = s[1];
    for (int i = 0; i < parts; i++) {
        double m0 = m, slope0 = 0.0;
        for (int stage = 0; stage < 2; stage++) {
            double x = (h + alpha * m) * per_a, man, dman;
            if (fabs(x) < 0.05) {
                double q = x * x;
                man = saturation * x * (1.0 / 3.0 - q * (1.0 / 45.0 - q * (2.0 / 945.0)));
                dman = saturation * per_a * (1.0 / 3.0 - q * (1.0 / 15.0 - q * (2.0 / 189.0)));
            } else {
                double coth = 1.0 / tanh(x), inverse = 1.0 / x;
                man = saturation * (coth - inverse);
                dman = saturation * per_a * (1.0 - coth * coth + inverse * inverse);
            }
            double gap = man - m, bends = p[3] * dman, over = most(1.0 + p[3] - alpha * p[3] * dman, 0.01);
            double pin = most(p[2] - alpha * fabs(gap), 0.01 * p[2]);
            int towards = (gap > 0.0) == rising;
            double rise = towards ? bends * pin + fabs(gap) : bends, run = towards ? over * pin : over;
            double slope = rise / run;
            if (stage == 0) {
                slope0 = slope;
                m = m0 + slope * dh;
                h += dh;
            } else {
                m = m0 + 0.5 * (slope0 + slope) * dh;
            }
        }
        m = least(most(m, -saturation), saturation);
    }
    s[1] = m;
    s[0] = position;
    return p[0] * s[1];
}

static inline double end_stop(const Bench *p, int i, double position, double rate)
{
    double depth = fabs(position) - p->gap[i];
    if (depth <= 0.0)
        return 0.0;
    return -copysign(p->stop_stiffness[i] * depth, position) - p->stop_damping[i] * depth * rate;
}

/* n samples from rest; noise (n, 9): amplifiers, then (noise, apex) of each head; reference and feedforward (period, 3);
   command, reading, current, head (n, 3) and temperature (n) are filled. */
void play(int64_t n, int64_t period, const Bench *restrict p, State *restrict state, const double *restrict noise,
          const double *restrict reference, const double *restrict feedforward, double *restrict command_out,
          double *restrict reading_out, double *restrict current_out, double *restrict head_out,
          double *restrict temperature_out)
{
    State s = *state;
    double part[3], scale[3], has_past = 0.0;
    for (int i = 0; i < 3; i++) {
        part[i] = -expm1(-2.0 * M_PI * p->bandwidth[i] * p->dt);
        scale[i] = p->noise[i] * sqrt((2.0 - part[i]) / part[i]);
    }
    for (int64_t sample = 0, k = 0; sample < n; sample++, k = k + 1 == period ? 0 : k + 1) {
        const double *w = noise + 9 * sample;
        double position[AXES], rate[AXES], head[3], reading[AXES], command[AXES], current[3], torque[AXES];
        for (int i = 0; i < AXES; i++) {
            position[i] = 0.0;
            rate[i] = p->rate_d[i] * s.torque[i];
            for (int m = FIRST[i]; m < FIRST[i + 1]; m++) {
                position[i] += p->c[m][0] * s.x[m][0] + p->c[m][1] * s.x[m][1];
                rate[i] += p->rate_c[m][0] * s.x[m][0] + p->rate_c[m][1] * s.x[m][1];
            }
        }
        for (int i = 0; i < 3; i++) {
            double seen = 0.0;
            for (int j = 0; j < AXES; j++)
                seen += p->to_heads[i][j] * position[j];
            head[i] = seen + p->head_noise[i] * w[3 + 2 * i]
                    + w[4 + 2 * i] * (p->apex_linear[i] * fabs(seen) + p->apex_quadratic[i] * seen * seen);
        }
        for (int i = 0; i < AXES; i++) {
            reading[i] = 0.0;
            for (int j = 0; j < 3; j++)
                reading[i] += p->to_reading[i][j] * head[j];
            if (i < 2)
                reading[i] += p->gain[i] * reading[i];
            double error = reference[3 * k + i] - reading[i], u = p->fd[i] * error;
            for (int m = 0; m < BLOCKS; m++) {
                double x0 = s.xf[i][m][0], x1 = s.xf[i][m][1];
                u += p->fc[i][m][0] * x0 + p->fc[i][m][1] * x1;
                s.xf[i][m][0] = p->fa[i][m][0][0] * x0 + p->fa[i][m][0][1] * x1 + p->fb[i][m][0] * error;
                s.xf[i][m][1] = p->fa[i][m][1][0] * x0 + p->fa[i][m][1][1] * x1 + p->fb[i][m][1] * error;
            }
            command[i] = feedforward[3 * k + i] + u;
        }
        double power = 0.0;
        for (int i = 0; i < 3; i++) {
            double drive = 0.0;
            for (int j = 0; j < AXES; j++)
                drive += p->to_current[i][j] * command[j];
            s.amplifier[i] += part[i] * (w[i] - s.amplifier[i]);
            drive += scale[i] * s.amplifier[i];
            current[i] = least(most(drive, -p->limit[i]), p->limit[i]);
            power += current[i] * current[i] / p->steepness;
        }
        s.temperature += p->dt / p->time_constant * (p->cold_k + p->resistance * power - s.temperature);
        double moving[AXES] = {0.0, 0.0, 0.0};
        for (int i = 0; i < 2; i++) {
            double q = position[i];
            const double *c = p->poly[i];
            moving[i] = jiles_atherton(p->ja[i], s.iron[i], q)
                      + (((((c[0] * q + c[1]) * q + c[2]) * q + c[3]) * q + c[4]) * q + c[5]) + p->trim[i]
                      - p->thermal[i] * (s.temperature - p->reference_k[i]) * q;
        }
        for (int i = 0; i < 3; i++) {
            double at = 0.0, speed = 0.0;
            for (int j = 0; j < AXES; j++) {
                at += p->lever[i][j] * position[j];
                speed += p->lever[i][j] * rate[j];
            }
            double push = end_stop(p, i, at, speed);
            for (int j = 0; j < AXES; j++)
                moving[j] += p->lever[i][j] * push;
        }
        for (int i = 0; i < AXES; i++) {
            torque[i] = 0.0;
            for (int j = 0; j < 3; j++)
                torque[i] += p->to_torque[i][j] * current[j];
            torque[i] += moving[i] + 0.5 * (moving[i] - s.past[i]) * has_past;
            s.past[i] = moving[i];
            s.torque[i] = torque[i];
            command_out[3 * sample + i] = command[i];
            reading_out[3 * sample + i] = reading[i];
            current_out[3 * sample + i] = current[i];
            head_out[3 * sample + i] = head[i];
            for (int m = FIRST[i]; m < FIRST[i + 1]; m++) {
                double x0 = s.x[m][0], x1 = s.x[m][1];
                s.x[m][0] = p->a[m][0][0] * x0 + p->a[m][0][1] * x1 + p->b[m][0] * torque[i];
                s.x[m][1] = p->a[m][1][0] * x0 + p->a[m][1][1] * x1 + p->b[m][1] * torque[i];
            }
        }
        has_past = 1.0;
        temperature_out[sample] = s.temperature;
    }
    *state = s;
}
