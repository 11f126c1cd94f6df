"""The paper's plants from the coefficients of Table 6.2 as printed, highest power first, in mrad, mm, N m and N."""

import numpy as np

from sim_backend.linear import ModalModel
from sim_backend.polynomial import modal_from_polynomial, modal_from_zpk, scaled_roots

THETA_X_NUM = (5.11e14, 3.72e16, 4.95e21, 1.00e23, 2.77e27)
THETA_X_DEN = (1.0, 178.5, 1.68e8, 1.45e10, 1.60e15, 4.85e16, 9.51e20, 9.71e21, 3.09e25)
THETA_Y_NUM = (2.53e14,)
THETA_Y_DEN = (1.0, 77.80, 8.19e7, 7.77e8, 2.76e12)
Z_NUM = (1.01e4,)
Z_DEN = (1.0, 10.48, 1.59e4)
STATIC_GAIN = 2.77e27 / 3.09e25 * 1e-3
RATE_HZ = 10_000.0


def pole_pair(frequency_hz: float, sigma_1_s: float) -> np.ndarray:
    omega = 2 * np.pi * frequency_hz
    root = 1j * np.sqrt(omega**2 - sigma_1_s**2)
    return np.array([-sigma_1_s + root, -sigma_1_s - root])


def product(poles: np.ndarray, zeros: np.ndarray, static_gain: float = STATIC_GAIN) -> ModalModel:
    """The plant with these poles and zeros (1/s) and the given gain at 0 Hz (rad per N m)."""
    gain = static_gain * np.prod(np.abs(poles)) / np.prod(np.abs(zeros))
    return modal_from_zpk(zeros, poles, gain)


def roots_near(coefficients: tuple[float, ...], frequency_hz: float) -> np.ndarray:
    """The pair of roots whose modulus is within 5 % of a frequency."""
    roots = scaled_roots(coefficients)
    return roots[np.abs(np.abs(roots) / (2 * np.pi * frequency_hz) - 1) < 0.05]


def theta_x_printed() -> ModalModel:
    return modal_from_polynomial(THETA_X_NUM, THETA_X_DEN, 1e-3)


def theta_x(frequency_hz: float = 1440.0, sigma_1_s: float = 34.0) -> ModalModel:
    """The printed plant with its highest pair of poles elsewhere and the same gain at 0 Hz."""
    poles = scaled_roots(THETA_X_DEN)
    kept = poles[np.abs(poles) < 2 * np.pi * 1700]
    return product(np.concatenate([kept, pole_pair(frequency_hz, sigma_1_s)]), scaled_roots(THETA_X_NUM))


def theta_x_part(*frequencies_hz: float) -> ModalModel:
    """The 29.6 Hz mode with the printed pole and zero pairs nearest the given frequencies, same gain at 0 Hz."""
    poles = [roots_near(THETA_X_DEN, f) for f in (29.6, *frequencies_hz)]
    zeros = [roots_near(THETA_X_NUM, f) for f in frequencies_hz]
    return product(np.concatenate(poles), np.concatenate([np.empty(0), *zeros]))


def theta_y() -> ModalModel:
    return modal_from_polynomial(THETA_Y_NUM, THETA_Y_DEN, 1e-3)


def z_axis() -> ModalModel:
    return modal_from_polynomial(Z_NUM, Z_DEN, 1e-3)
