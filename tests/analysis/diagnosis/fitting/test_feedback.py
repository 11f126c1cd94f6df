"""What effects do in turn when a motion changes, against differences of full simulations."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.candidates.parameters import parameters_of
from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.fitting.problem import Problem
from analysis.diagnosis.fitting.slopes import Slopes
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.tuning import nuisances_of
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from sim_backend.assembly import places_of, transducers_of
from sim_backend.effects import effect_class
from tests.analysis.diagnosis.two_modes import RATE_HZ, drive, linear_model, one_axis

Array = np.ndarray
STILL = {"stiffness_2": 0.0, "stiffness_3": 0.0, "stiffness_4": 0.0}
SPRING = ("hysteresis", "theta_x", {"stiffness_1": 2.0, **STILL, "reach": 1e3})  # a spring that never slips


def columns(*effects: tuple[str, str, dict[str, float]]) -> tuple[Array, Array, Array]:
    """Return the nuisances' columns by differences of simulations, with torques held, and with effects that answer."""
    exact, held, answered = (found[:, :-more] for found, more in all_columns(*effects))
    return exact, held, answered


def all_columns(*effects: tuple[str, str, dict[str, float]]) -> list[tuple[Array, int]]:
    """Return the same with those of the effects' parameters after them, each with the number of these."""
    model, linear = one_axis(), linear_model()
    u = drive(8000)
    data = Dataset(RATE_HZ, (Record("r", u, np.zeros((8000, 1)), (Window("all", 0, 8000),)),))
    whitener = Whitener(np.array([[1e6]]), True)
    nuisances, starts = nuisances_of(linear, 0.03), starts_of(data, linear, whitener)
    still = (np.zeros((2, 2)),)
    setting = Setting(data, linear, (), places_of(model), transducers_of(model), nuisances, whitener, starts, still, 8)
    candidates = []
    for name, where, values in effects:
        effect = effect_class(name)
        shapes = {p.name: values[p.name] for p in effect.parameters() if not p.size}
        units = {p.name: values[p.name] or 1.0 for p in effect.parameters() if p.size}
        candidates.append(Candidate(effect, where, shapes, units, shapes))
    sizes = np.array([float(values[n] != 0.0) for (_, _, values), c in zip(effects, candidates, strict=True)
                      for n in c.unit_sizes])  # fmt: skip
    scales, start = parameters_of(candidates, sizes)
    problem = Problem(setting, tuple(candidates), scales)
    x = np.concatenate([np.zeros(len(nuisances)), start])
    at = problem.evaluate(x)
    how = Slopes(problem), Slopes(problem), Slopes(problem, strong=True)
    assert how[0].truer()
    found = [slopes.normal(x, at) and slopes.latest(x, at)[: -x.size] for slopes in how]
    return [(one, start.size) for one in found]


def error(columns: Array, exact: Array) -> Array:
    """Return the relative error of every column."""
    return np.asarray(np.linalg.norm(columns - exact, axis=0) / np.linalg.norm(exact, axis=0))


def softer(part: float) -> tuple[str, str, dict[str, float]]:
    """Return a mode that has lost a part of its stiffness at about the rms of the drive's motion."""
    return "slow-softening", "mode 1", {"softening": part, "level": 5e-3, "memory": 1.0}


def test_beside_a_spring_columns_are_those_of_the_whole_loop() -> None:
    """In phase and linear: nothing is left out but what a torque does within one sample."""
    exact, held, answered = columns(SPRING, softer(1e-9))
    assert np.median(error(held, exact)) > 0.2
    assert np.max(error(answered, exact)) < 0.05


def test_in_a_softer_mode_columns_are_those_of_that_mode() -> None:
    """What the level itself follows of a change is left out: it is of second order in what is lost."""
    exact, held, answered = columns(softer(0.01))
    own = slice(0, 3)  # the other mode has nothing to do with it
    assert np.all(error(answered, exact)[own] < error(held, exact)[own] / 2.0)


def test_parameters_of_an_effect_in_a_mode_have_columns_without_a_simulation() -> None:
    """Alone they are right but for what the level itself follows; beside a spring, what the loop does is in them."""
    for more in ((), (SPRING,)):
        (exact, number), _, (answered, _) = all_columns(softer(0.01), *more)
        own = slice(exact.shape[1] - number, exact.shape[1] - number + 2)  # what is lost, and how long it is remembered
        assert np.all(np.linalg.norm(exact[:, own], axis=0) > 0.0)
        assert np.all(np.any(answered[:, own] != exact[:, own], axis=0))
        assert np.all(error(answered[:, own], exact[:, own]) < 0.1), error(answered[:, own], exact[:, own])
