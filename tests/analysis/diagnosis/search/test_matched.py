"""The residual through the plant backwards: a gradient, and the rounding that it finds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.diagnosis.search.matched import wanted_inputs
from sim_backend.effects.command_quantisation import CommandQuantisation
from sim_backend.effects.view import RecordView
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, moved, setting_of

N = 12_000


def _force(rng: np.random.Generator) -> np.ndarray:
    time = np.arange(N) / RATE_HZ
    return np.asarray(sum(np.sin(2.0 * np.pi * f * time + rng.uniform(0.0, 6.0)) for f in (3.1, 7.3, 17.9, 31.7)))


def test_it_is_the_gradient_of_the_log_likelihood() -> None:
    """Differences of ½ Σ (residual / noise)² along a random change of the input, with scipy's simulation."""
    rng = np.random.default_rng(1)
    force, residual, noise = _force(rng), 0.01 * rng.standard_normal(N), 0.01
    setting, _ = setting_of(force, moved(force) + residual, residual, noise)
    (wanted,), (answer,) = wanted_inputs(setting, MODEL.linear(), [residual[:, None]])
    change = rng.standard_normal(N)
    # the likelihood is quadratic, so a central difference is exact
    by_hand = [-0.5 * float(np.sum(((residual - s * moved(change)) / noise) ** 2)) for s in (1.0, -1.0)]
    assert wanted @ change == pytest.approx(0.5 * (by_hand[0] - by_hand[1]), rel=1e-6)
    pulse = np.zeros(N)
    pulse[0] = 1.0
    assert np.linalg.norm(answer) == pytest.approx(float(np.linalg.norm(moved(pulse) / noise)), rel=1e-6)


def _view(force: np.ndarray, residual: np.ndarray, noise: float) -> RecordView:
    setting, _ = setting_of(force, moved(force) + residual, residual, noise)
    (wanted,), (answer,) = wanted_inputs(setting, MODEL.linear(), [residual[:, None]])
    none = np.zeros(N)
    return RecordView(RATE_HZ, force, none, none, none, None, 20.0, wanted, answer)


@pytest.mark.parametrize("step", [0.0113, 0.047, 0.31])
def test_the_step_of_a_rounded_command_is_among_the_starts(step: float) -> None:
    """To a part in a thousand of the step that the command is shifted by against its lattice."""
    rng = np.random.default_rng(2)
    force = _force(rng)
    noise = 0.02 * step
    residual = moved(step * np.rint(force / step) - force) + noise * rng.standard_normal(N)
    starts = [s["step_size"] for s in CommandQuantisation.guess(_view(force, residual, noise))]
    # a start that is off by δq shifts the command by size/q · δq/q steps; a tenth of one keeps 9 tenths of the energy
    near = 0.1 * step**2 / float(np.sqrt(np.mean(force**2)))
    assert min(abs(s - step) for s in starts) < near


def test_what_cannot_be_seen_is_not_tried() -> None:
    """Steps begin where a rounding moves the readings by four standard deviations in all."""
    rng = np.random.default_rng(3)
    force = _force(rng)
    view = _view(force, 0.5 * rng.standard_normal(N), 0.5)
    # the last sample moves no reading that is recorded, so that one row of 12,000 does not count
    steps = view.rounding_steps()
    assert np.all(np.diff(steps) > 0.0)
    assert steps[0] * view.seen * np.sqrt(N / 12.0) == pytest.approx(4.0, rel=1e-3)
    assert CommandQuantisation.choices(view) == steps.size


@pytest.mark.parametrize("cycles", [7, 311, 2900])
def test_what_a_torque_explains_that_swings_with_time_is_as_least_squares_has_it(cycles: int) -> None:
    """The matched filter takes its two columns for orthogonal and of one energy.

    They are so to the root of the number of independent samples: the resonance is 4 Hz wide and 12 s long, so 0.1.
    """
    rng = np.random.default_rng(4)
    force, noise = lfilter([1.0], [1.0, -0.9], rng.standard_normal(N)), 0.3
    angle = 2.0 * np.pi * cycles / N * np.arange(N)
    waves = [moved(force * wave) / noise for wave in (np.cos(angle), np.sin(angle))]
    swinging = 0.8 * waves[0] - 0.6 * waves[1]
    residual = noise * (rng.standard_normal(N) + 12.0 * swinging / np.linalg.norm(swinging))
    view = _view(force, residual, noise)
    basis, _ = np.linalg.qr(np.stack(waves, axis=1))
    explained = view.modulations(force)
    assert explained[cycles] == pytest.approx(float(np.sum((basis.T @ residual / noise) ** 2)), rel=0.2)
    assert np.argmax(explained[5:]) + 5 == cycles


def test_nothing_swings_in_noise_alone() -> None:
    """Each frequency whose torque reaches the readings explains the squares of two deviations: on average two."""
    rng = np.random.default_rng(5)
    force = lfilter([1.0], [1.0, -0.9], rng.standard_normal(N))
    explained = _view(force, 0.5 * rng.standard_normal(N), 0.5).modulations(force)
    assert float(np.mean(explained)) == pytest.approx(2.0, rel=0.05)
    assert float(np.max(explained)) < 2.0 * np.log(1e3 * explained.size)
