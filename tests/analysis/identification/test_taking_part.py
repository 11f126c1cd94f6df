"""Channels that take no part in a free record: they cost nothing, change nothing, and are told of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.identification.driven import answering
from analysis.identification.identified import Identification
from analysis.identification.identify import identify_runs
from analysis.identification.normal_equations import Minimum, minimise
from analysis.linear.simulate import simulate_linear
from campaigns.log import LogWriter, read_run
from campaigns.plans import make_plan
from campaigns.playing.runner import run_plan
from sim_backend.bench import Signal
from sim_backend.linear import ModalModel, discretise
from sim_backend.model import EffectEntry
from sim_backend.simbench import SimBench
from tests.small_bench import NOISE, bench_model

Array = NDArray[np.float64]

RATE_HZ = 10_000.0
CUBIC = EffectEntry(effect="cubic-stiffness", where="theta_x", parameters={"stiffness": 2e4})
SETTINGS = {"axes": ["theta_x"], "steps_s": 0.3, "noise_s": 0.3, "held_out_s": 0.2}


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Return a list of what every fit in time takes: its numbers and its steps."""
    taken: list[tuple[int, int]] = []

    def counted(*given: Any) -> Minimum:
        found = minimise(*given)
        taken.append((found.parameters.size, found.iterations))
        return found

    monkeypatch.setattr("analysis.identification.timefit.minimise", counted)
    return taken


def identified(path: Path) -> Identification:
    with read_run(path) as run:
        return identify_runs([run], modes=(1, 2))


def one_driven(folder: Path) -> Path:
    """Return a log of three axes of which one moves, with a spring that stiffens and quiet sensors."""
    path = folder / "three.h5"
    run_plan(make_plan("freerun", SETTINGS), SimBench(bench_model((*NOISE, CUBIC)), 2), path, seed=2)
    return path


def alone(path: Path) -> Path:
    """Return a log with the channels of the driven axis alone."""
    own = path.with_name("alone.h5")
    signals = (
        Signal("command_theta_x", "N m", "input", "theta_x", RATE_HZ),
        Signal("theta_x", "rad", "output", "theta_x", RATE_HZ),
    )
    with read_run(path) as run, LogWriter.create(own, signals, test="alone", bench=run.header.bench) as log:
        for segment in run.segments:
            with log.segment(segment.label):
                log.append({one.name: run.read(one.name, segment.start, segment.stop) for one in signals})
    return own


def test_axes_at_rest_cost_no_step_and_change_nothing(tmp_path: Path, steps: list[tuple[int, int]]) -> None:
    path = one_driven(tmp_path)
    whole = identified(path)
    taken, steps[:] = list(steps), []
    part = identified(alone(path))
    assert taken and taken == steps
    assert [one.total for one in whole.held_out] == [one.total for one in part.held_out]
    assert [list(one.per_output) for one in whole.held_out] == [["theta_x"], ["theta_x"]]
    assert [port.dof for port in whole.model.outputs] == [port.dof for port in whole.model.inputs]
    assert len(whole.model.outputs) == 3
    response = whole.model.linear().frequency_response(np.array([10.0]))[0]
    own = part.model.linear().frequency_response(np.array([10.0]))[0]
    np.testing.assert_array_equal(response, np.pad(own, (0, 2)))
    assert any("outputs theta_y, z answer no input" in remark for remark in whole.remarks)
    assert any("inputs command_theta_y, command_z move in no log" in remark for remark in whole.remarks)


def _mode() -> ModalModel:
    one, none = np.ones((1, 1)), np.zeros((1, 1))
    return ModalModel(np.array([2.0 * np.pi * 29.6]), np.array([4.7]), one, none, one, none, none, np.zeros(1))


def _band(rng: np.random.Generator, rows: int) -> Array:
    """Return noise (n, 1) up to 200 Hz."""
    spectrum = np.fft.rfft(rng.standard_normal((rows, 1)), axis=0)
    spectrum[rows // 50 :] = 0.0
    return np.fft.irfft(spectrum, rows, axis=0)


@pytest.mark.parametrize("seed", range(4))
def test_an_output_far_below_its_noise_answers_all_the_same(seed: int) -> None:
    """A response of a tenth of the noise rms: of 10,000 samples 100 squared deviations, a chance of 10⁻²¹."""
    rng = np.random.default_rng(seed)
    u = _band(rng, 10_000)
    y = simulate_linear(discretise(_mode(), RATE_HZ), u)
    read = np.hstack([0.1 * y / y.std() + rng.standard_normal(y.shape), rng.standard_normal(y.shape)])
    assert answering([u], [read], RATE_HZ).tolist() == [True, False]


def test_a_free_motion_is_no_noise() -> None:
    rng = np.random.default_rng(0)
    u = _band(rng, 10_000)
    swing = simulate_linear(discretise(_mode(), RATE_HZ), np.zeros_like(u), np.array([[1.0, 0.0]]))
    assert answering([u], [swing + 0.1 * rng.standard_normal(u.shape)], RATE_HZ).all()


def test_drifting_noise_answers_nothing() -> None:
    rng = np.random.default_rng(1)
    u = _band(rng, 10_000)
    coloured = np.convolve(rng.standard_normal(10_100), 0.9 ** np.arange(100), "valid")[:10_000, None]
    assert not answering([u], [coloured], RATE_HZ).any()


def test_a_constant_output_is_left_to_be_refused() -> None:
    u = _band(np.random.default_rng(2), 2000)
    assert answering([u], [np.ones_like(u)], RATE_HZ).all()
