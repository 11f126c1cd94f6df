"""Numbers that were tuned by a few lines are wrong for rows that shake a bench elsewhere, as much as is foretold."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from analysis.diagnosis.evidence.gain import errors_in_noise, size_on_held_out
from analysis.diagnosis.evidence.tuning_errors import tuning_errors
from analysis.diagnosis.fitting.balance import tune
from analysis.diagnosis.fitting.fit import Setting, linear_of, residuals_on
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.nominal.tuning import nuisances_of, turned
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.verdict.held_out import surely_misses
from sim_backend.assembly import places_of, transducers_of
from sim_backend.linear import played
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, RESONANCE_HZ, Array

N, NOISE_M, TOLERANCE = 4000, 1e-3, 0.03
LINEAR = MODEL.linear()
NUISANCES = nuisances_of(LINEAR, TOLERANCE)
WHITENER = Whitener(np.array([[1.0 / NOISE_M]]), repeats=True)


def drawn(seed: int) -> tuple[Dataset, Array]:
    """Return data of a bench that is other than its model by the tolerance, tuned by two slow lines, held out in noise.

    And the noise of the held-out record.
    """
    rng = np.random.default_rng(seed)
    bench = played(turned(LINEAR, NUISANCES, TOLERANCE * rng.standard_normal(len(NUISANCES))), RATE_HZ)
    t = np.arange(N) / RATE_HZ
    slow = 0.3 * np.sin(2.0 * np.pi * 1.0 * t) + 0.3 * np.sin(2.0 * np.pi * 3.0 * t)
    records = []
    for name, u, held_out in (("fitted", slow, False), ("held out", rng.standard_normal(N), True)):
        noise = NOISE_M * rng.standard_normal((N, 1))
        y = simulate(bench, u[:, None]) + noise
        records.append(Record(name, u[:, None], y, (Window(name, 0, N, held_out, 0),)))
    return Dataset(RATE_HZ, tuple(records)), noise


def tuned_on(data: Dataset):
    fitted = data.for_fitting()
    starts, still = starts_of(fitted, LINEAR, WHITENER), tuple(np.zeros((1, 2)) for _ in fitted.records)
    places, transducers = places_of(MODEL), transducers_of(MODEL)
    return tune(Setting(fitted, LINEAR, (), places, transducers, NUISANCES, WHITENER, starts, still, 1, 1))


def test_what_is_left_of_unseen_rows_is_as_large_as_foretold():
    found, foretold = [], []
    for seed in range(30):
        data, noise = drawn(seed)
        setting, tuned = tuned_on(data)
        errors = tuning_errors(data, setting, tuned)
        assert list(errors) == [1] and errors[1].shape == (N, 1, len(NUISANCES))
        found.append(np.mean((residuals_on(data, setting, tuned)[1] - noise) ** 2))
        foretold.append(np.sum(errors[1] ** 2) / N)
    # the mean of thirty squares of two or three numbers each: a third, three standard deviations would be two thirds
    assert np.mean(found) == pytest.approx(np.mean(foretold), rel=2.0 / 3.0)
    assert np.mean(foretold) > NOISE_M**2  # such an error is no part of the noise


@pytest.mark.parametrize(("part", "right"), [(1.0, True), (0.0, False)])
def test_a_size_on_unseen_rows_is_as_uncertain_as_it_is_said(part, right):
    """Held-out rows have this part of a line that was added: with all of it the addition is right, with none wrong."""
    off, narrow, missed = [], 0, 0
    for seed in range(30):
        data, _ = drawn(seed)
        setting, tuned = tuned_on(data)
        line = 3.0 * NOISE_M * np.sin(2.0 * np.pi * 19.0 * np.arange(N) / RATE_HZ)[:, None]
        fitted, left = residuals_on(data, setting, tuned)
        before, after = (fitted, left + part * line), (fitted, left + (part - 1.0) * line)
        linear = linear_of(setting, tuned)
        errors = errors_in_noise(data, tuning_errors(data, setting, tuned), WHITENER, linear)
        times, std = size_on_held_out(data, before, after, WHITENER, linear, linear, errors)
        off.append((times - part) / std)
        missed += surely_misses(times, std)
        alone, bare = size_on_held_out(
            data, before, after, WHITENER, linear, linear, errors_in_noise(data, {}, WHITENER, linear)
        )
        narrow += abs(alone - part) > 3.0 * bare
    assert np.mean(np.square(off)) < 2.0 and np.max(np.abs(off)) < 4.0
    if right:
        assert np.mean(np.square(off)) > 0.4 and missed == 0
        assert narrow > 3  # with the noise alone, sizes are surely wrong that are right
    else:  # what it adds counts as noise as well, so that its size is less certain
        assert missed > 20


def test_a_model_without_numbers_to_tune_has_no_errors():
    data, _ = drawn(0)
    setting, tuned = tuned_on(data)
    bare = replace(setting, nuisances=[]), replace(tuned, change=np.zeros(0))
    assert tuning_errors(data, *bare) == {}


def test_numbers_that_only_the_nominal_model_tells_apart_have_its_tolerance():
    """Noise so small that products of columns would lose the prior of two modes that look alike."""
    data, _ = drawn(0)
    (mode,) = MODEL.modes
    twin = msgspec.structs.replace(mode, label="twin", frequency_hz=RESONANCE_HZ * (1.0 + 1e-9))
    linear = msgspec.structs.replace(MODEL, modes=[mode, twin]).linear()
    setting, tuned = tuned_on(data)
    nuisances = nuisances_of(linear, TOLERANCE)
    whitener = Whitener(np.array([[1e9 / NOISE_M]]), repeats=True)
    fitted = data.for_fitting()
    quiet = replace(
        setting, nominal=linear, nuisances=nuisances, whitener=whitener, starts=starts_of(fitted, linear, whitener)
    )
    fit = replace(tuned, change=np.zeros(len(nuisances)))
    (errors,) = tuning_errors(data, quiet, fit).values()
    assert np.all(np.isfinite(errors))
