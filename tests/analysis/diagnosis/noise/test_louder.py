"""Noise that a random cause makes louder: in the whitener, through every refit, and in what stands out beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.fitting.balance import tune
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.noise.whitener import Bands, Whitener, louder
from analysis.diagnosis.pipeline import Options, diagnose, found_with_variance_effects
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, flicker, moved, setting_of

HUMP = Bands(np.array([0.0, 0.02, 0.1, 0.5]), np.array([[1.0, 6.0, 1.0]]))


def test_guessed_bands_stay_what_they_are() -> None:
    """Below what periods show a level is read off the residual; flat is what it is above, with a hump there or not."""
    rng = np.random.default_rng(5)
    rows, period = 12_000, 2000
    reading = flicker(rng, rows)[:, None]
    data = Dataset(RATE_HZ, (Record("made", reading, reading, (Window("all", 0, rows, period=period),)),))
    before = whitener_from(data, [reading])
    after = before.with_bands(HUMP)
    assert before.guessed > 0 and after.guessed == before.guessed
    kept = after.guessed + 1
    assert np.array_equal(after.edges[:kept], before.edges[:kept])
    assert np.all(np.diff(after.edges) > 1e-9)
    middle = 0.5 * (after.edges[:-1] + after.edges[1:])
    own = Bands(before.edges, before.levels).at(middle)
    assert after.levels == pytest.approx(np.maximum(own, HUMP.at(middle)))
    assert np.array_equal(after.flat().levels[:, : kept - 1], np.full((1, kept - 1), after.levels[0, kept - 1]))


def test_a_filter_without_bands_gets_them() -> None:
    plain = Whitener(np.ones((1, 1)), True)
    raised = louder(plain, (HUMP, Bands(np.array([0.05, 0.5]), np.array([[2.0]]))))
    assert Bands(raised.edges, raised.levels).at(np.array([0.01, 0.03, 0.07, 0.3]))[0].tolist() == [1.0, 6.0, 6.0, 2.0]


def test_it_stays_through_tuning() -> None:
    """The noise is estimated anew with every fit, and what was added to it is added again."""
    rng = np.random.default_rng(6)
    force, noise = np.tile(rng.standard_normal(1000), 6), 0.01 * rng.standard_normal(6000)
    reading = moved(force) + noise
    setting = replace(setting_of(force, reading, noise, 0.01, period=1000)[0], states=(np.zeros((1, 2)),))
    quiet, _ = tune(setting)
    loud, _ = tune(replace(setting, added=(HUMP,)))
    inside = np.array([0.05])
    levels = [Bands(s.whitener.edges, s.whitener.levels).at(inside)[0, 0] for s in (quiet, loud)]
    assert levels[0] < 2.0 and levels[1] == 6.0


@pytest.mark.parametrize("seed", range(6))
def test_what_stands_out_only_in_the_loudest_rows_gets_no_name(seed: int) -> None:
    """Noise that is forty times as strong at the largest deflection, in steps that go there for a tenth of the time."""
    rng = np.random.default_rng(seed)
    steps = np.where(rng.uniform(size=24) < 0.1, 1.0, rng.uniform(-0.15, 0.15, 24))
    force = np.tile(np.repeat(steps, 125), 4)
    x = moved(force)
    reading = x + 0.002 * np.sqrt(1.0 + (6.0 * x) ** 2) * rng.standard_normal(x.size)
    record = Record("made", force[:, None], reading[:, None], (Window("all", 0, x.size, period=3000),))
    data = Dataset(RATE_HZ, (record,))
    found, spread = found_with_variance_effects(data, MODEL, Options(), lambda what, part: None)
    assert [type(c.effect).name for c in spread.causes] == ["apex-noise"]
    assert found.best.candidates == ()
    said = diagnose(data, MODEL, Options())
    assert [c.effect for c in said.causes] in (["apex-noise"], [])
