"""Table 6.4 recomputed: a feed-forward designed on the 29.6 Hz mode alone, played to plants with more modes.

Paper (overshoot in µrad, settling in ms): 2nd order 0 and 4.9; with 125 Hz 29 and 320; with 500 Hz 11 and 72;
with 1500 Hz 23 and 80; complete 61 and 320. Ours, at 10 kHz with 50 samples (5 ms, as the text says) and with 46, stand
in `ROWS`. With 50 the row with 500 Hz does not come out, with 46 every overshoot and settling of a row with a second
mode does; the tests at the end say why that row is so sensitive and what was tried.
"""

import numpy as np
import pytest

from analysis.measurements.settling import settling
from sim_backend.control.feedforward import least_norm, least_peak_within, step_response
from sim_backend.linear import discretise
from tests.sim_backend.paper_plants import (
    RATE_HZ,
    THETA_X_DEN,
    pole_pair,
    product,
    roots_near,
    theta_x,
    theta_x_part,
    theta_x_printed,
)

STEP = 8.5e-3
DESIGN = theta_x_part()


def _with_high_mode(frequency_hz, sigma_1_s):
    poles = np.concatenate([roots_near(THETA_X_DEN, 29.6), pole_pair(frequency_hz, sigma_1_s)])
    return product(poles, np.empty(0))


# name: plant, our overshoot (µrad) and settling (ms) with 50 samples and with 46
ROWS = {
    "2nd order": (DESIGN, (0.0, 4.9), (0.0, 4.5)),
    "125 Hz": (theta_x_part(123.25), (29.9, 327.2), (31.8, 335.0)),
    "500 Hz": (theta_x_part(485.0), (1.5, 4.9), (11.6, 72.8)),
    "1440 Hz": (_with_high_mode(1440.0, 34.0), (33.0, 93.5), (22.4, 80.4)),
    "2000 Hz as printed": (_with_high_mode(1999.9, 47.32), (22.5, 59.5), (18.5, 57.8)),
    "complete, 1440 Hz": (theta_x(), (60.6, 327.2), (56.4, 335.1)),
    "complete, as printed": (theta_x_printed(), (47.9, 327.2), (51.6, 335.0)),
}


def _settled(plant, samples=50):
    move = least_norm(DESIGN, STEP, samples, RATE_HZ)
    y = step_response(discretise(plant, RATE_HZ), move, 5000)[:, 0]
    return settling(y, RATE_HZ, final=STEP)


@pytest.mark.parametrize("row", ROWS)
def test_our_rows_of_table_6_4(row):
    plant, *ours = ROWS[row]
    for samples, (overshoot_urad, settling_ms) in zip((50, 46), ours, strict=True):
        result = _settled(plant, samples)
        assert np.isclose(1e6 * result.overshoot[0], overshoot_urad, atol=0.06)
        assert np.isclose(1e3 * result.time_s[0], settling_ms, atol=0.06)


def _arrival_amplitude(plant, mode, samples=50):
    """Amplitude of one mode's free ring at arrival, from the transform of the held input at its pole: no simulation."""
    move = least_norm(DESIGN, STEP, samples, RATE_HZ)
    pole = plant.poles_1_s()[mode, 0]
    dt = 1 / RATE_HZ
    residue = (plant.c[0, mode] + plant.c_rate[0, mode] * pole) / (2j * pole.imag)
    ages = dt * (samples - 1 - np.arange(samples))
    held = (np.exp(pole * dt) - 1) / pole
    driven = np.sum(move.drive[:, 0] * np.exp(pole * ages)) * held
    return 2 * abs(residue * (driven + move.holding[0] / pole))


@pytest.mark.parametrize(("row", "mode"), [("125 Hz", 1), ("1440 Hz", 1), ("2000 Hz as printed", 1)])
def test_rings_equal_the_spectrum_of_the_input_at_the_pole(row, mode):
    """Settling is when the mode's amplitude, decaying at its rate, enters the band."""
    plant = ROWS[row][0]
    amplitude, sigma = _arrival_amplitude(plant, mode), plant.sigma_1_s[mode]
    predicted_s = 50 / RATE_HZ + np.log(amplitude / 1.7e-6) / sigma
    half_period_s = np.pi / plant.omega_rad_s[mode]
    # the 29.6 Hz mode is left with up to 1 µrad by the added mode, which can shift the crossing by ln(2.7/1.7)/sigma
    slack_s = half_period_s + np.log(2.7 / 1.7) / sigma
    assert abs(_settled(plant).time_s[0] - predicted_s) < slack_s


def test_the_paper_rows_agree_with_the_decay_of_their_modes():
    """Overshoot and settling of each paper row fit an amplitude that decays at its mode's rate from 5 ms on.

    1500 Hz needs 34 1/s, the damping of theta_y's mode; the printed 47 1/s would settle in 60 ms.
    """
    for overshoot_urad, settling_ms, sigma in ((29.0, 320.0, 9.013), (11.0, 72.0, 28.13), (23.0, 80.0, 34.0)):
        # two printed digits: half a unit of the overshoot is up to 4.5 %, of the settling 5 or 0.5 ms
        expected_ms = 5.0 + 1e3 * np.log(overshoot_urad / 1.7) / sigma
        assert abs(expected_ms - settling_ms) < 1e3 * 0.045 / sigma + (5.0 if settling_ms > 100 else 0.5)
    assert 5.0 + 1e3 * np.log(23.0 / 1.7) / 47.32 < 61.0


def test_500_hz_lies_in_a_gap_of_the_inputs_spectrum():
    """Why that row is so small here: 489.5 Hz x 5 ms = 2.45 periods, next to a gap near 2.5.

    A mode of the same kind would have to ring at 453 Hz to leave the paper's 11 µrad.
    """
    zero_over_pole = 479.834 / 489.487

    def ring_urad(frequency_hz):
        poles = np.concatenate([roots_near(THETA_X_DEN, 29.6), pole_pair(frequency_hz, 28.13)])
        plant = product(poles, pole_pair(zero_over_pole * frequency_hz, 27.43))
        return 1e6 * _arrival_amplitude(plant, 1)

    assert np.isclose(ring_urad(489.487), 1e6 * _arrival_amplitude(ROWS["500 Hz"][0], 1), rtol=0.01)
    rings = {f: ring_urad(f) for f in np.arange(440.0, 560.0, 1.0)}
    assert abs(min(rings, key=rings.__getitem__) - 500.0) < 12.0
    assert rings[489.0] < 0.2 * rings[453.0]
    assert np.isclose(rings[453.0], 11.0, atol=1.0)


def test_of_all_lengths_up_to_5_ms_only_46_samples_bring_all_rows():
    """Over 40 to 60 samples two moves meet the four overshoots within a tenth: 46 and 57 samples.

    57 exceed the 5 ms of the text, and the 2nd-order plant then settles in 5.6 ms. With 46 it settles in 4.5 ms where
    the paper says 4.9, which is our 50 samples; with 50 the 500 Hz row is off by 87 %.
    """
    paper = {"125 Hz": 29.0, "500 Hz": 11.0, "1440 Hz": 23.0, "complete, 1440 Hz": 61.0}
    worst = {}
    for samples in range(40, 61):
        ours = {row: 1e6 * _settled(ROWS[row][0], samples).overshoot[0] for row in paper}
        worst[samples] = max(abs(ours[row] / paper[row] - 1) for row in paper)
    assert [samples for samples, off in worst.items() if off < 0.1] == [46, 57]
    # the next best lengths are off by more than a third
    assert min(off for samples, off in worst.items() if samples <= 50 and samples != 46) > 0.33
    assert np.isclose(worst[50], 0.87, atol=0.01)
    for samples, settling_ms in ((46, 4.5), (57, 5.6)):
        assert np.isclose(1e3 * _settled(DESIGN, samples).time_s[0], settling_ms, atol=1e-9)


@pytest.mark.parametrize(("samples", "peak_nm"), [(49, 5.07), (50, 4.69)])
def test_rest_to_rest_of_the_complete_plant_asks_for_more_than_the_amplifiers_give(samples, peak_nm):
    """At 30 mm, 4.7 N m is 104 N on one actuator; 9 A give 51 N."""
    move = least_norm(theta_x(), STEP, samples, RATE_HZ)
    assert np.isclose(move.peak, peak_nm, atol=0.005)
    assert move.peak * 2 / (3 * 0.030) > 9 * 5.7
    y = step_response(discretise(theta_x(), RATE_HZ), move, 1000)[:, 0]
    assert np.isclose(1e3 * settling(y, RATE_HZ, final=STEP).time_s[0], (samples - 1) / 10, atol=1e-9)


@pytest.mark.parametrize(("samples", "peak_nm"), [(50, 0.369), (40, 0.594)])
def test_a_quiet_output_alone_is_cheap(samples, peak_nm):
    """The output alone needs 0.37 N m for 5.0 ms and 0.59 N m for 4.0 ms, if the input may go on acting."""
    move = least_peak_within(theta_x(), STEP, samples, 1.7e-6, 200, RATE_HZ, rest=False)
    assert np.isclose(move.peak, peak_nm, atol=0.0005)


def test_coming_to_rest_behind_the_quiet_output_is_dear():
    """With every mode at rest within 40 ms the least peak is 2.2 N m, six times the 0.37 N m of a quiet output alone.

    The zeros at 122.9 Hz hold a motion that the output does not show and that dies out with 9 1/s: at 40 ms
    some 70 % is left, and the input has to have fought it from the start.
    """
    move = least_peak_within(theta_x(), STEP, 50, 1.7e-6, 400, RATE_HZ)
    assert np.isclose(move.peak, 2.21, atol=0.01)
