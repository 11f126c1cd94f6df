"""Replays beside each other give what each gives alone, to the last bit, wherever what they share is the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from sim_backend import kernel
from sim_backend.assembly import places_of, transducers_of
from sim_backend.effects import make_effect
from sim_backend.effects.base import Effect
from sim_backend.kernel import machine, side_by_side
from sim_backend.kernel.structure import LANES, Structure
from sim_backend.layout import Ints
from sim_backend.linear import ModalModel
from sim_backend.replay import Case, Motion, replay_together, stepped
from tests.lanes import lanes_asked
from tests.sim_backend.test_kernel import RATE_HZ, one_axis

MODEL = one_axis()
PLACES, TRANSDUCERS, LINEAR = places_of(MODEL), transducers_of(MODEL), MODEL.linear()
U = 0.02 * np.random.default_rng(5).standard_normal((2000, LINEAR.n_inputs))
AXIS, DRIVE = PLACES.outputs[0], PLACES.inputs[0]


@pytest.fixture
def lanes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return how many replays each loop played that was asked for; loops for several are made at once."""
    return lanes_asked(monkeypatch)


def softer(k: int) -> ModalModel:
    return LINEAR.with_(omega_rad_s=LINEAR.omega_rad_s * (1.0 - 1e-3 * k))


def acting(k: int) -> list[Effect]:
    """Return effects of several sites, with and without a memory, one of which a recording drives."""
    return [
        make_effect("hysteresis", AXIS, {"stiffness_1": 0.4 + 0.1 * k, "reach": 1e-4}),
        make_effect("cubic-stiffness", AXIS, {"stiffness": 1e6 * (1 + k)}),
        make_effect("position-dependent-force-constant", DRIVE, {"linear": 5.0 * k, "quadratic": 1e3}),
        make_effect("amplifier-saturation", DRIVE, {"limit": 0.03 - 1e-3 * k}),
        make_effect("sample-clock-error", AXIS, {"relative": 4e-5 * k}),
    ]


def played(cases: Sequence[Case]) -> list[Motion]:
    temperature_k = 290.0 + np.linspace(0.0, 3.0, U.shape[0])
    return replay_together(cases, PLACES, TRANSDUCERS, U, RATE_HZ, temperature_k=temperature_k)


def assert_as_alone(cases: Sequence[Case]) -> None:
    for case, found in zip(cases, played(cases), strict=True):
        (alone,) = played([case])
        for name in ("reading", "position", "torque", "states"):
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name), err_msg=name)


@pytest.mark.parametrize("substeps", (1, 4))
def test_replays_of_other_numbers_share_a_loop(lanes: list[int], substeps: int) -> None:
    cases = [
        Case(
            stepped(softer(k), acting(k), PLACES, RATE_HZ, substeps),
            acting(k),
            1e-5 * k * np.ones((LINEAR.n_blocks, 2)),
        )
        for k in range(LANES + 2)
    ]
    assert_as_alone(cases)
    assert lanes.count(LANES) == (substeps >= side_by_side.WORTH_CALLING)


def test_an_effect_that_hangs_on_the_recorded_temperature_is_played_beside_others(lanes: list[int]) -> None:
    effects = [[make_effect("thermal-stiffness-drift", AXIS, {"coefficient": 0.1 * (1 + k)})] for k in range(LANES)]
    assert_as_alone([Case(stepped(LINEAR, own, PLACES, RATE_HZ, 4), own) for own in effects])
    assert LANES in lanes


def test_delays_share_a_loop_only_where_they_end_in_one_sample(lanes: list[int]) -> None:
    def late(delays: Sequence[float]) -> list[Case]:
        models = [LINEAR.with_(delay_s=np.full(LINEAR.n_inputs, d / RATE_HZ)) for d in delays]
        return [Case(stepped(model, [], PLACES, RATE_HZ, 8), []) for model in models]

    assert_as_alone(late([3.0] * LANES))
    assert lanes.count(LANES) == 1
    assert_as_alone(late([3.0, 3.0, 3.0, 5.0]))
    assert_as_alone(late([2.0, 2.3, 2.6, 2.9]))
    assert_as_alone(late([0.0, 0.0, 0.4, 0.0]))  # one of them needs a faster loop
    assert lanes.count(LANES) <= 2


def test_replays_that_are_unlike_are_played_one_by_one(lanes: list[int]) -> None:
    cases = [
        Case(stepped(LINEAR, own, PLACES, RATE_HZ, 4), own) for own in (acting(k)[: 1 + k % 2] for k in range(LANES))
    ]
    assert_as_alone(cases)
    assert LANES not in lanes


def test_a_loop_for_several_replays_is_made_once_it_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Structure] = []
    monkeypatch.setattr(machine, "make_aside", made.append)
    monkeypatch.setattr(machine, "load", lambda structure: structure.lanes == 1)
    monkeypatch.setattr(side_by_side, "LONG_SIDE_BY_SIDE", 2 * LANES * U.shape[0])
    kernel.played.clear()
    cases = [Case(stepped(softer(k), acting(k), PLACES, RATE_HZ, 4), acting(k)) for k in range(LANES)]
    for _ in range(2):
        played(cases)
        assert not made
    played(cases)
    assert [s.lanes for s in made] == [LANES]
    kernel.played.clear()


def test_a_bench_of_a_search_that_is_played_for_long_gets_its_effects_inlined(
    lanes: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Structure] = []
    run = kernel.Loop.run

    def asking(loop: kernel.Loop, structure: Structure, table: Ints) -> None:
        asked.append(structure)
        run(loop, structure, table)

    monkeypatch.setattr(kernel.Loop, "run", asking)
    monkeypatch.setattr(machine, "load", machine.is_loaded)  # as if none were on disk
    monkeypatch.setattr(kernel, "LONG_REPLAYED", 5 * (LANES + 1) * U.shape[0] * 2)
    for name in ("_loaded", "_locks"):
        monkeypatch.setattr(machine, name, {})
    kernel.played.clear()
    cases = [Case(stepped(softer(k), acting(k), PLACES, RATE_HZ, 5), acting(k)) for k in range(LANES + 1)]
    called = [played(cases) for _ in range(2)][0]
    assert not any(structure.inlined for structure in asked)
    played(cases)
    machine.wait()
    asked.clear()
    inlined = played(cases)
    assert asked and all(structure.inlined for structure in asked)
    for one, other in zip(called, inlined, strict=True):
        for name in ("reading", "position", "torque", "states"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    kernel.played.clear()


def test_a_motion_that_goes_too_far_is_given_up_and_its_neighbours_are_not(lanes: list[int]) -> None:
    """Of four, one swings 31 times as far; the others are as without a limit, to the last bit."""
    effects = [[make_effect("actuator-gain", DRIVE, {"relative": gain})] for gain in (0.0, 0.1, 30.0, 0.2)]
    cases = [Case(stepped(LINEAR, own, PLACES, RATE_HZ, 4), own) for own in effects]
    free = played(cases)
    limit = 10.0 * np.max(np.abs(free[0].reading), axis=0)
    held = replay_together(cases, PLACES, TRANSDUCERS, U, RATE_HZ, farthest=limit)
    assert [bool(np.isinf(motion.reading).all()) for motion in held] == [False, False, True, False]
    for i in (0, 1, 3):
        for name in ("reading", "position", "torque", "states"):
            np.testing.assert_array_equal(getattr(held[i], name), getattr(free[i], name), err_msg=name)
    assert LANES in lanes


def test_only_what_a_reading_sees_goes_too_far() -> None:
    """A mode at the sample rate is at the same place at every sample; between two it swings ten times as far.

    A step that is 0.9 samples late meets every sample a tenth of a period after the mode was at rest.
    """
    between = LINEAR.with_(
        omega_rad_s=np.full(1, 2.0 * np.pi * RATE_HZ), sigma_1_s=np.zeros(1), delay_s=np.full(1, 0.9 / RATE_HZ)
    )
    ready, u = stepped(between, [], PLACES, RATE_HZ, 4), np.full((2000, 1), 0.02)
    assert ready.finer > 1
    swing = 2.0 * 0.02 * between.c[0, 0] * between.b[0, 0] / between.omega_rad_s[0] ** 2
    (free,) = replay_together([Case(ready, [])], PLACES, TRANSDUCERS, u, RATE_HZ)
    assert np.max(free.reading) == pytest.approx(0.5 * (1.0 - np.cos(0.2 * np.pi)) * swing, rel=1e-3)
    (held,) = replay_together([Case(ready, [])], PLACES, TRANSDUCERS, u, RATE_HZ, farthest=np.full(1, 0.5 * swing))
    np.testing.assert_array_equal(held.reading, free.reading)
