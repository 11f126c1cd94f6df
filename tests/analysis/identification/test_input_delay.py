"""A delay of the input is taken into the model where the records show one, and what is left is the noise."""

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.identification.input_delay import with_delay
from analysis.identification.timefit import TimeFit, fit_records
from analysis.linear.simulate import simulate_linear
from sim_backend.linear import ModalModel, discretise
from sim_backend.model import Mode, Model, Port

RATE_HZ, ROWS, FINER = 200.0, 6000, 10
MEMORY, SIZE = 0.9, 0.01


def plant() -> ModalModel:
    mode = Mode(label="x", frequency_hz=21.0, decay_rate_1_s=15.0, input={"force": 1.7e4}, output={"x": 1.0})
    ports = [Port(name="force", unit="N", dof="x")], [Port(name="x", unit="m", dof="x")]
    return Model(name="one mode", sample_rate_hz=RATE_HZ, inputs=ports[0], outputs=ports[1], modes=[mode]).linear()


def played(late_samples: float, seed: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Return input and output (n, 1), and the innovation's size of the output's noise of ten samples' memory.

    It is played in steps a tenth of a sample long, so that the delay is a whole number of them.
    """
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((ROWS, 1))
    fine = np.repeat(u, FINER, axis=0)
    shifted = np.concatenate([np.zeros((round(FINER * late_samples), 1)), fine])[: fine.shape[0]]
    y = simulate_linear(discretise(plant(), FINER * RATE_HZ), shifted)[::FINER]
    innovation = SIZE * float(y.std()) * np.sqrt(1.0 - MEMORY**2)
    noise = lfilter([innovation], [1.0, -MEMORY], rng.standard_normal(ROWS))
    return u, y + noise[:, None], innovation


def fits(u: np.ndarray, y: np.ndarray) -> tuple[TimeFit, TimeFit]:
    fit = fit_records([u], [y], RATE_HZ, 1)
    return fit, with_delay(fit, [u], [y], RATE_HZ)


def test_without_a_delay_the_fit_is_left_alone() -> None:
    u, y, _ = played(0.0, 1)
    fit, late = fits(u, y)
    assert late is fit


@pytest.mark.parametrize("late_samples", [0.3, 1.0, 1.6])
def test_what_a_late_input_leaves_is_noise(late_samples: float) -> None:
    u, y, innovation = played(late_samples, 2)
    fit, late = fits(u, y)
    assert fit.noise_std[0] > 1.5 * innovation
    # n innovations tell their size to 1/√(2n), 0.9 %: four of those
    assert late.noise_std[0] == pytest.approx(innovation, rel=4.0 / np.sqrt(2.0 * ROWS))
    # the delay itself shares what it does with the feedthrough and the rate that is read; the mode shares nothing
    assert late.model.omega_rad_s[0] / (2.0 * np.pi) == pytest.approx(
        21.0, abs=4.0 * late.omega_std_rad_s[0] / (2.0 * np.pi)
    )
