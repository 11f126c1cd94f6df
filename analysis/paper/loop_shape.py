"""The feedback loop of θx in the frequency domain: sensitivity, complementary sensitivity and margins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_backend.control.feedback import Margins, loop_margins, theta_controller
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

LOW_HZ, HIGH_HZ = 1.0, 4900.0


def open_loop(plant: ModalModel, frequency_hz: Array, hold_rate_hz: float | None = None) -> ComplexArray:
    """Return plant times controller, (f,); with `hold_rate_hz` the plant behind its zero-order hold."""
    response = plant.frequency_response(frequency_hz, hold_rate_hz)[:, 0, 0]
    return np.asarray(response * theta_controller().frequency_response(frequency_hz))


def loop_margins_of(plant: ModalModel, hold_rate_hz: float | None = None, factor: float = 1.0) -> Margins:
    """Return the margins of the loop times `factor`, without the hold as the printed gain margin was, or with it."""
    return loop_margins(lambda f: factor * open_loop(plant, f, hold_rate_hz), LOW_HZ, HIGH_HZ, points=4000)
