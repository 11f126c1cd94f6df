"""Feedback controllers of the three axes, and their loops: margins, sensitivity, closed-loop poles.

The controller of theta_x and theta_y is rebuilt from its description, not from its printed coefficients: with
those the rounding moves the integrator to z = 1.049 and the loop diverges. `LoopShape` holds the description.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from sim_backend.control.blocks import DiscreteFilter, filter_from_zpk, tustin_zpk
from sim_backend.control.realisation import realised
from sim_backend.errors import ConfigError
from sim_backend.linear import DiscreteModel

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Response = Callable[[Array], ComplexArray]


@dataclass(frozen=True)
class LoopShape:
    """A tip-tilt controller by its parts: integrator with a zero, skew notch, low pass; Tustin at `rate_hz`.

    The defaults reproduce every printed coefficient of the paper's controller within half a unit of the last digit.
    `leading_nm_per_rad` is the first coefficient of the discrete numerator, printed as 0.1722 N m/mrad.
    `integrator_zero_hz` is chosen so that, with the skew notch on the 29.6 Hz mode, the z² coefficient comes out as
    printed. Raises ConfigError when a frequency, a damping or the gain is not positive.
    """

    integrator_zero_hz: float = 68.58
    notch_zero_hz: float = 29.6
    notch_zero_damping: float = 0.53
    notch_pole_hz: float = 500.0
    notch_pole_damping: float = 1.0
    low_pass_hz: float = 251.0
    leading_nm_per_rad: float = 172.19
    rate_hz: float = 10_000.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0.0):
                raise ConfigError(f"feedback: {name} is {value}; it must be a finite number above zero")

    def continuous_zpk(self) -> tuple[ComplexArray, ComplexArray, float]:
        """Return zeros (3,), poles (4,) in s⁻¹ and the gain that Tustin converts to `leading_nm_per_rad`."""
        tau = 2.0 * np.pi
        zeros = np.append(_pair(self.notch_zero_hz, self.notch_zero_damping), -tau * self.integrator_zero_hz)
        poles = np.append(_pair(self.notch_pole_hz, self.notch_pole_damping), [0.0, -tau * self.low_pass_hz])
        unit = tustin_zpk(zeros, poles, 1.0, self.rate_hz)[2]
        return zeros, poles, self.leading_nm_per_rad / unit

    def filter(self) -> DiscreteFilter:
        """Return the controller in N m per rad, its integrator alone in the first block."""
        return filter_from_zpk(*tustin_zpk(*self.continuous_zpk(), self.rate_hz), self.rate_hz)


def _pair(frequency_hz: float, damping: float) -> ComplexArray:
    omega = 2.0 * np.pi * frequency_hz
    root = omega * np.sqrt(complex(damping**2 - 1.0))
    return np.array([-damping * omega + root, -damping * omega - root])


LEARNING_GAIN_FACTOR = 1.5
"""What the paper multiplies the feedback gain by when it closes the loop after learning (section 6.3.2)."""


def theta_controller(gain_factor: float = 1.0) -> DiscreteFilter:
    """Return the controller of theta_x and theta_y at 10 kHz, N m per rad, times a factor; section 6.3.1."""
    return LoopShape().filter().scaled(gain_factor)


def pid_forward_euler(kp: float, ki: float, kd: float, bandwidth_rad_s: float, rate_hz: float) -> DiscreteFilter:
    """Return kp + ki/s + kd N s/(s + N), N = `bandwidth_rad_s`, by the forward Euler rule.

    The rule is s = rate (z - 1). The gains are in output per input unit (times s⁻¹ and s). Raises ConfigError
    when the rule makes the derivative filter unstable, which it does from N = 2 rate on.
    """
    pole = 1.0 - bandwidth_rad_s / rate_hz
    if not abs(pole) < 1.0:
        raise ConfigError(
            f"derivative filter of {bandwidth_rad_s} rad/s at {rate_hz} Hz has its pole at z = {pole:.3g}; "
            f"keep its bandwidth between 0 and {2.0 * rate_hz} rad/s"
        )
    # kd N (z - 1)/(z - pole) = kd N - kd N (1 - pole)/(z - pole)
    a = np.array([[[1.0, 0.0], [0.0, 0.0]], [[pole, 0.0], [0.0, 0.0]]])
    b = np.array([[ki / rate_hz, 0.0], [1.0, 0.0]])
    c = np.array([[1.0, 0.0], [-kd * bandwidth_rad_s * (1.0 - pole), 0.0]])
    return DiscreteFilter(a, b, c, kp + kd * bandwidth_rad_s, rate_hz, integrator=0)


def z_controller(rate_hz: float = 10_000.0) -> DiscreteFilter:
    """Return the PID of z in N per m; section 6.3.1, its gains read as N/mm, N/(mm s) and N s/mm."""
    per_mm = 1e3
    return pid_forward_euler(89.0 * per_mm, 1000.0 * per_mm, 0.56 * per_mm, 4012.6, rate_hz)


@dataclass(frozen=True)
class Margins:
    """Margins of one loop L with their frequencies, and the peaks of |1/(1+L)| and |L/(1+L)|.

    The gain margin is the smallest change of gain, up or down, and the phase margin the smallest further lag
    that lead to instability, over all crossings; infinite where a loop has no such crossing.
    """

    gain_margin_db: float
    gain_margin_hz: float
    phase_margin_deg: float
    crossover_hz: float
    sensitivity_peak_db: float
    sensitivity_peak_hz: float
    complementary_peak_db: float


def sensitivity(loop: ArrayLike) -> ComplexArray:
    """Return S = 1/(1 + L) of the open-loop response L, any shape. Source: Fig. 6.10."""
    return np.asarray(1.0 / (1.0 + np.asarray(loop)), dtype=complex)


def complementary_sensitivity(loop: ArrayLike) -> ComplexArray:
    """Return T = L/(1 + L) of the open-loop response L, any shape. Source: Fig. 6.10."""
    return np.asarray(np.asarray(loop) / (1.0 + np.asarray(loop)), dtype=complex)


def loop_margins(loop: Response, low_hz: float, high_hz: float, points: int = 5_000) -> Margins:
    """Return the margins of the open-loop response `loop(frequency_hz)` between two frequencies.

    Crossings are bracketed on a logarithmic grid and then solved for, so the grid needs to separate the
    resonances but not to resolve them. Raises ConfigError when the range is empty.
    """
    if not 0.0 < low_hz < high_hz:
        raise ConfigError(f"margins between {low_hz} and {high_hz} Hz: the range is empty; give 0 < low < high")
    f = np.geomspace(low_hz, high_hz, points)
    response = loop(f)

    def at(frequency: float) -> complex:
        return complex(loop(np.array([frequency]))[0])

    real_axis = [scipy.optimize.brentq(lambda x: at(x).imag, f[k], f[k + 1]) for k in _sign_changes(response.imag)]
    gains = [(-20.0 * np.log10(abs(at(x))), x) for x in real_axis if at(x).real < 0.0]
    unit_circle = [
        scipy.optimize.brentq(lambda x: abs(at(x)) - 1.0, f[k], f[k + 1]) for k in _sign_changes(np.abs(response) - 1.0)
    ]
    # the lag that turns L onto -1: an angle from 0 to 360 degrees
    phases = [(np.rad2deg(np.angle(-at(x))) % 360.0, x) for x in unit_circle]
    gain, gain_hz = min(gains, key=lambda g: abs(g[0]), default=(np.inf, np.nan))
    phase, cross_hz = min(phases, default=(np.inf, np.nan))
    s_peak, s_peak_hz = _peak(lambda x: abs(1.0 / (1.0 + at(x))), f, np.abs(sensitivity(response)))
    t_peak, _ = _peak(lambda x: abs(at(x) / (1.0 + at(x))), f, np.abs(complementary_sensitivity(response)))
    s_peak_db, t_peak_db = 20.0 * np.log10(s_peak), 20.0 * np.log10(t_peak)
    return Margins(*(float(x) for x in (gain, gain_hz, phase, cross_hz, s_peak_db, s_peak_hz, t_peak_db)))


def _sign_changes(values: Array) -> NDArray[np.intp]:
    return np.flatnonzero(np.signbit(values[:-1]) != np.signbit(values[1:]))


def _peak(function: Callable[[float], float], f: Array, values: Array) -> tuple[float, float]:
    k = int(np.argmax(values))
    low, high = f[max(k - 1, 0)], f[min(k + 1, f.size - 1)]
    best = scipy.optimize.minimize_scalar(
        lambda x: -function(x), bounds=(low, high), method="bounded", options={"xatol": 1e-9 * high}
    )
    return max((-float(best.fun), float(best.x)), (float(values[k]), float(f[k])))


def closed_loop_poles(
    plant: DiscreteModel, controller: DiscreteFilter, output: int = 0, input_: int = 0
) -> ComplexArray:
    """Return the poles (n,) in z of one input and output of `plant` under negative feedback, any order.

    The delay is included. Raises ConfigError when the rates differ.
    """
    if plant.rate_hz != controller.rate_hz:
        raise ConfigError(
            f"plant at {plant.rate_hz} Hz and controller at {controller.rate_hz} Hz; build both at one rate"
        )
    a_p, b_p, c_p, direct = realised(plant, output, input_)
    a_c, b_c, c_c, d_c = controller.state_space()
    # e = -(c_p x + direct u), u = c_c x_c + d_c e: solved for e first
    share = 1.0 / (1.0 + direct * float(d_c[0, 0]))
    e_p, e_c = -share * c_p, -share * direct * c_c
    u_p, u_c = d_c @ e_p, c_c + d_c @ e_c
    return np.asarray(
        np.linalg.eigvals(np.block([[a_p + b_p @ u_p, b_p @ u_c], [b_c @ e_p, a_c + b_c @ e_c]])),
        dtype=complex,
    )
