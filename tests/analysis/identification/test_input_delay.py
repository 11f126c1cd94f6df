"""A delay of the input is taken into the model where the records show one, and what is left is the noise."""

import numpy as np
import pytest
from scipy.signal import chirp, cont2discrete, lfilter

from analysis.identification.input_delay import fit_whole_delay, with_delay
from analysis.identification.modal_parameters import Structure
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
    # neither a direct path nor a rate that is read shares what the delay does
    std = float(np.sqrt(np.diag(late.covariance)[late.layout.index("delay_s")][0])) * RATE_HZ
    assert late.model.delay_s[0] * RATE_HZ == pytest.approx(late_samples, abs=4.0 * std) and std < 0.01
    assert not (late.model.d.any() or late.model.c_rate.any())
    assert late.model.omega_rad_s[0] / (2.0 * np.pi) == pytest.approx(
        21.0, abs=4.0 * late.omega_std_rad_s[0] / (2.0 * np.pi)
    )


ORDERS = (1, 2, 3, 4)


def identified(u: np.ndarray, y: np.ndarray, rate_hz: float) -> TimeFit:
    """Return the fit of as many modes as records of one input and one output (n, 1) show, with its delay."""

    def search(inputs, outputs):
        return fit_records(inputs, outputs, rate_hz, ORDERS, rigid_bodies=None)

    fit = fit_whole_delay(search, [u], [y], rate_hz, ORDERS, Structure())
    return with_delay(fit, [u], [y], rate_hz)


def drives(rng: np.random.Generator, rate_hz: float, rows: int) -> dict[str, np.ndarray]:
    """Return one input (rows,) of every kind: two that follow from their past, and one that does not."""
    t = np.arange(rows) / rate_hz
    lines = np.arange(1, 250)
    phase = rng.uniform(0.0, 2.0 * np.pi, (lines.size, 1))
    period = np.sum(np.cos(2.0 * np.pi * lines[:, None] * t[:1000] + phase), axis=0) / np.sqrt(lines.size)
    return {
        "chirp": chirp(t, 1.0, t[-1], 300.0),
        "multisine": np.tile(period, rows // 1000),
        "white": rng.standard_normal(rows),
    }


@pytest.mark.parametrize(
    ("drive", "modes", "late"),
    [("chirp", ((70.0, 0.02),), 5), ("multisine", ((40.0, 0.01), (180.0, 0.02)), 3), ("white", ((90.0, 0.05),), 2)],
)
def test_modes_that_imitate_a_delay_give_way_to_it(drive: str, modes, late: int) -> None:
    """Whatever moves the bench: as many modes as there are, and their delay of whole samples to a fifth of one."""
    rate_hz, rng = 1000.0, np.random.default_rng(7)
    u = drives(rng, rate_hz, 6000)[drive]
    y = np.zeros(u.size)
    for frequency_hz, ratio in modes:
        omega = 2.0 * np.pi * frequency_hz
        b, a, _ = cont2discrete(([omega**2], [1.0, 2.0 * ratio * omega, omega**2]), 1.0 / rate_hz, method="zoh")
        y += lfilter(b[0], a, np.concatenate([np.zeros(late), u[:-late]]))
    y += 3e-3 * y.std() * rng.standard_normal(u.size)
    found = identified(u[:, None], y[:, None], rate_hz)
    assert found.model.delay_s[0] * rate_hz == pytest.approx(late, abs=0.2)
    assert np.sort(found.model.omega_rad_s) / (2.0 * np.pi) == pytest.approx([f for f, _ in modes], rel=1e-3)
