"""Numbers that were tuned by a few lines are wrong for rows that shake a bench elsewhere, as much as is foretold."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.evidence.gain import size_on_held_out
from analysis.diagnosis.evidence.tuning_errors import tuning_errors
from analysis.diagnosis.fitting.balance import tune
from analysis.diagnosis.fitting.fit import Setting, linear_of, residuals_on
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import played, simulate
from analysis.diagnosis.nominal.tuning import nuisances_of, turned
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from sim_backend.assembly import places_of, transducers_of
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, Array

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


def test_a_right_addition_has_its_size_beside_wrong_numbers():
    """A line that neither record shows to the tuning is added by hand, half in and half out of the fit's reach."""
    off, wrong = [], 0
    for seed in range(30):
        data, _ = drawn(seed)
        setting, tuned = tuned_on(data)
        line = 3.0 * NOISE_M * np.sin(2.0 * np.pi * 19.0 * np.arange(N) / RATE_HZ)[:, None]
        after = list(residuals_on(data, setting, tuned))
        before = [after[0], after[1] + line]
        linear = linear_of(setting, tuned)
        errors = tuning_errors(data, setting, tuned)
        times, std = size_on_held_out(data, before, after, WHITENER, linear, linear, errors)
        alone, narrow = size_on_held_out(data, before, after, WHITENER, linear, linear, {})
        off.append((times - 1.0) / std)
        wrong += abs(alone - 1.0) > 3.0 * narrow
    assert np.mean(np.square(off)) < 2.0 and np.max(np.abs(off)) < 4.0
    assert wrong > 3  # without them, sizes are surely wrong that are right
