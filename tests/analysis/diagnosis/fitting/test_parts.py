"""Axes that have nothing to do with each other, fitted one by one, against the fit of all at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.candidates.parameters import parameters_of
from analysis.diagnosis.candidates.signature import Candidate, Scales, unit_sizes
from analysis.diagnosis.fitting.balance import reestimated
from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.fitting.parts import parts_of, setting_of
from analysis.diagnosis.fitting.problem import Problem
from analysis.diagnosis.fitting.refit import exact_sensitivities, in_parts, refit
from analysis.diagnosis.fitting.slopes import Slopes
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.tuning import nuisances_of
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from sim_backend.assembly import places_of, transducers_of
from sim_backend.effects import effect_class, make_effect
from sim_backend.effects.base import Effect
from sim_backend.effects.cubic_stiffness import CubicStiffness
from sim_backend.model import Mode, Model, Port, Value
from sim_backend.replay import replay

RATE_HZ = 1000.0
NOISE_RAD = 1e-6
INERTIA = 3.23e-4
HIDDEN = (
    make_effect("cubic-stiffness", "theta_x", {"stiffness": 2e3}),
    make_effect("extra-resonance", "theta_y", {"participation": 0.05, "frequency_hz": 80.0, "damping_ratio": 0.02}),
)


def axes(*, seen_by_both: bool = False) -> Model:
    """Three axes, their modes in no order; a sensor may see two of them."""

    def mode(label: str, hz: float, axis: str, share: float, **more: float) -> Mode:
        outputs: dict[str, Value] = {f"theta_{axis}": 1.0, **more}
        into: dict[str, Value] = {f"torque_{axis}": share / INERTIA}
        return Mode(label=label, frequency_hz=hz, decay_rate_1_s=6.0, input=into, output=outputs)

    crossed = {"theta_x": 0.02} if seen_by_both else {}
    names = ("x", "y", "z")
    return Model(
        name="three axes",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name=f"torque_{a}", unit="N m", dof=f"theta_{a}") for a in names],
        outputs=[Port(name=f"theta_{a}", unit="rad", dof=f"theta_{a}") for a in names],
        modes=[
            mode("y low", 24.0, "y", 1.0, **crossed),
            mode("x low", 30.0, "x", 1.0),
            mode("z", 45.0, "z", 1.0),
            mode("y high", 150.0, "y", -0.3),
            mode("x high", 210.0, "x", 0.4),
        ],
    )


def measured(model: Model, hidden: tuple[Effect, ...] = (), seed: int = 3) -> Setting:
    """Noise of 1 µrad, nuisances off by a thousandth, records that begin in motion."""
    rng = np.random.default_rng(seed)
    nominal = model.linear()
    true = nominal.with_(omega_rad_s=nominal.omega_rad_s * (1.0 + 0.001 * rng.standard_normal(nominal.n_blocks)))
    records = []
    for r in range(2):
        u = 0.02 * np.cumsum(rng.standard_normal((3000, 3)), axis=0) / np.sqrt(3000)
        start = 1e-5 * rng.standard_normal((nominal.n_blocks, 2)) * [1.0, 100.0]
        y = replay(true, hidden, places_of(model), transducers_of(model), u, RATE_HZ, start=start, substeps=4).reading
        y = y + NOISE_RAD * rng.standard_normal(y.shape)
        records.append(Record(f"record {r}", u, y, (Window("all", 0, 2500), Window("rest", 2500, 3000, held_out=True))))
    data = Dataset(RATE_HZ, tuple(records))
    whitener = Whitener(np.full((3, 1), 1.0 / NOISE_RAD), True)
    still = tuple(np.zeros((nominal.n_blocks, 2)) for _ in records)
    starts = starts_of(data, nominal, whitener)
    nuisances = nuisances_of(nominal, 0.03)
    return Setting(data, nominal, (), places_of(model), transducers_of(model), nuisances, whitener, starts, still, 4)


def scales_of(setting: Setting) -> Scales:
    return Scales(setting.data.u_scale(), setting.data.y_scale(), 1.0 / (2 * np.pi * 24.0), 10.0)


def candidate(setting: Setting, effect: Effect) -> Candidate:
    """An effect as a candidate, its shapes somewhat off."""
    shapes = {p.name: 1.02 * getattr(effect, p.name) for p in effect.parameters() if not p.size}
    units = unit_sizes(type(effect), effect.where, setting.places, scales_of(setting))
    return Candidate(type(effect), effect.where, shapes, units, shapes)


def hypothesis(setting: Setting, effects: tuple[Effect, ...]) -> tuple[list[Candidate], np.ndarray]:
    found = [candidate(setting, e) for e in effects]
    sizes = [
        0.9 * getattr(e, name) / unit
        for e, c in zip(effects, found, strict=True)
        for name, unit in c.unit_sizes.items()
    ]
    return found, np.array(sizes)


@pytest.mark.parametrize("hidden", [(), HIDDEN[:1], HIDDEN[1:], HIDDEN, HIDDEN[::-1]])
def test_a_fit_of_separate_axes_is_the_fit_of_all(hidden: tuple[Effect, ...]) -> None:
    setting = measured(axes(), hidden)
    candidates, sizes = hypothesis(setting, hidden)
    none = np.zeros(len(setting.nuisances))
    assert [len(part.outputs) for part, _ in in_parts(setting, candidates, sizes)] == [1, 1, 1]
    fit = refit(setting, candidates, sizes, none, exact=True)
    # the same numbers, put into the whole problem, leave the same
    held, own = fit.held()
    scales, x = parameters_of(held, own)
    whole = Problem(setting, tuple(held), scales)
    x = np.concatenate([fit.change, x])
    at = whole.evaluate(x)
    assert at.objective == pytest.approx(fit.objective, rel=1e-9)
    for ours, theirs in zip(fit.residuals, at.residuals, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6 * NOISE_RAD)
    # and it has nothing to gain from there
    slopes = Slopes(whole)
    further, best = whole.descend(slopes, x, 5)
    assert fit.objective - best.objective < 0.3
    all_at_once = whole.finish(further, best, slopes.latest(further, best), {})
    assert fit.occam == pytest.approx(all_at_once.occam, abs=0.1)
    np.testing.assert_allclose(fit.change_std, all_at_once.change_std, rtol=0.03)
    np.testing.assert_allclose(fit.std, all_at_once.std, rtol=0.03)
    assert (fit.names, fit.rows) == (all_at_once.names, all_at_once.rows)
    assert np.all(np.abs(fit.values - all_at_once.values) < 0.3 * fit.std)
    if hidden:
        truth = [getattr(hidden[i], name) for i, name in fit.names]
        assert np.all(np.abs(fit.values - truth) < 4.0 * fit.std)


def test_a_start_is_brought_up_to_date_from_where_the_fit_was_simulated() -> None:
    setting = measured(axes(), HIDDEN)
    fit = refit(setting, (), np.zeros(0), np.zeros(len(setting.nuisances)))
    elsewhere = replace(setting, states=tuple(states + 1.0 for states in setting.states))
    for own, other in zip(reestimated(setting, fit).states, reestimated(elsewhere, fit).states, strict=True):
        np.testing.assert_array_equal(own, other)
    moved = refit(elsewhere, (), np.zeros(0), np.zeros(len(setting.nuisances)))
    assert not np.allclose(reestimated(setting, moved).states[0], moved.states[0])
    np.testing.assert_array_equal(moved.states[0], elsewhere.states[0])


def test_starts_with_a_mode_that_an_effect_added() -> None:
    setting = measured(axes(), HIDDEN)
    candidates, sizes = hypothesis(setting, HIDDEN)
    fit = refit(setting, candidates, sizes, np.zeros(len(setting.nuisances)))
    settled = reestimated(setting, fit)
    assert settled.states[0].shape == (6, 2)  # five modes and the one that was added
    held, own = fit.held()
    found = in_parts(settled, held, own)
    assert [part.modes.tolist() for part, _ in found] == [[1, 4], [0, 3, 5], [2]]
    for part, mine in found:
        np.testing.assert_array_equal(mine.states[0], settled.states[0][part.modes])
        rows = settled.data.records[0].fitted().sum()
        there = np.concatenate([np.arange(o * rows, (o + 1) * rows) for o in part.outputs])
        for whole, start in zip(settled.starts, mine.starts, strict=True):
            np.testing.assert_allclose(start.q.T @ start.q, np.eye(start.q.shape[1]), atol=1e-9)
            white = np.random.default_rng(0).standard_normal(len(whole.q))
            np.testing.assert_allclose(start.project(white[there]), whole.project(white)[there], atol=1e-9)


def test_sensitivities_of_separate_axes_are_those_of_all() -> None:
    setting = measured(axes(), HIDDEN)
    candidates, sizes = hypothesis(setting, HIDDEN)
    fit = refit(setting, candidates, sizes, np.zeros(len(setting.nuisances)))
    held, own = fit.held()
    scales, x = parameters_of(held, own)
    whole = Problem(setting, tuple(held), scales)
    x = np.concatenate([fit.change, x])
    here, _ = whole.raw(x)
    ours = exact_sensitivities(setting, fit)
    for i in range(x.size):
        (slope,) = whole.slopes(x, [i], here)
        assert slope is not None
        for r, column in enumerate(slope):
            size = np.max(np.abs(column))
            np.testing.assert_allclose(ours[r][:, :, i], -column, atol=1e-5 * size)


@pytest.mark.parametrize(
    ("effect", "where", "values", "together"),
    [
        ("cubic-stiffness", "theta_x", {"stiffness": 1.0}, [[0], [1], [2]]),
        ("cross-coupling", "theta_z->theta_x", {"gain": 1.0}, [[0, 2], [1]]),
        ("sensor-gain", "theta_y", {"relative": 0.1}, [[0], [1], [2]]),
    ],
)
def test_what_an_effect_joins(effect: str, where: str, values: dict[str, float], together: list[list[int]]) -> None:
    setting = measured(axes())
    made = make_effect(effect, where, values)
    own = candidate(setting, made)
    parts = parts_of(setting, [own], [made])
    assert [part.outputs.tolist() for part in parts] == together
    assert [len(part.candidates) for part in parts].count(1) == 1


def test_a_sensor_that_sees_two_axes_joins_them() -> None:
    setting = measured(axes(seen_by_both=True))
    assert [part.outputs.tolist() for part in parts_of(setting, [], [])] == [[0, 1], [2]]


def test_an_actuator_and_a_head_reach_every_axis() -> None:
    setting = measured(axes())
    for name, where in (("amplifier-saturation", "a1"), ("sensor-gain", "head 1")):
        own = Candidate(effect_class(name), where, {}, {}, {})
        assert parts_of(setting, [own], []) == []


def test_starts_that_join_axes_keep_them_together() -> None:
    coupled = measured(axes(seen_by_both=True))
    setting = measured(axes())
    (part, *_) = parts_of(setting, [], [])
    assert setting_of(setting, part) is not None
    assert setting_of(replace(setting, starts=coupled.starts), part) is None


def test_a_size_that_cannot_be_is_left_to_the_fit() -> None:
    setting = replace(measured(axes(), HIDDEN[:1]), workers=1)
    candidates, _ = hypothesis(setting, HIDDEN[:1])
    fit = refit(setting, candidates, np.array([np.nan]), np.zeros(len(setting.nuisances)))
    assert np.isfinite(fit.misfit)
    assert isinstance(fit.effects[0], CubicStiffness) and isinstance(HIDDEN[0], CubicStiffness)
    assert abs(fit.effects[0].stiffness - HIDDEN[0].stiffness) < 4.0 * fit.std[0]
