"""Few columns are taken of many: those that explain more than they cost, and none that something else is already."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.search.forward import MOST, other_than, taken_from
from analysis.diagnosis.search.gram import Gram

ROWS, COLUMNS = 4000, 20


def gram_of(residual: np.ndarray, columns: np.ndarray, own: np.ndarray | None = None) -> Gram:
    parts = [residual[:, None], columns] + ([] if own is None else [own])
    whole = np.concatenate(parts, axis=1)
    groups = (np.arange(1, 1 + COLUMNS), *((np.arange(1 + COLUMNS, whole.shape[1]),) if own is not None else ()))
    return Gram(whole.T @ whole, 0, groups, (False,) * len(groups), ROWS, True)


def test_the_columns_that_made_it_are_taken_strongest_first_and_no_others() -> None:
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((ROWS, COLUMNS))
    gram = gram_of(0.4 * columns[:, 7] - 0.2 * columns[:, 3] + rng.standard_normal(ROWS), columns)
    taken = taken_from(gram, gram.groups[0], np.ones(COLUMNS, dtype=bool), np.zeros(COLUMNS))
    assert [one.which for one in taken] == [7, 3]
    assert all(one.explains > one.costs > 2.0 * np.log(COLUMNS) for one in taken)
    # what a squared size of 0.16 and 0.04 explains of so many rows, within four deviations of noise
    np.testing.assert_allclose([one.explains for one in taken], [640.0, 160.0], atol=8.0 * np.sqrt(640.0))


def test_what_may_not_be_taken_and_what_costs_more_stays() -> None:
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((ROWS, COLUMNS))
    gram = gram_of(0.4 * columns[:, 7] + 0.1 * columns[:, 3] + rng.standard_normal(ROWS), columns)
    without = np.arange(COLUMNS) != 7
    dear = np.where(np.arange(COLUMNS) == 3, 100.0, 0.0)
    assert [one.which for one in taken_from(gram, gram.groups[0], without, np.zeros(COLUMNS))][:1] == [3]
    assert [one.which for one in taken_from(gram, gram.groups[0], ~without | (dear > 0.0), dear)] == [7]


def test_no_more_are_taken_than_three_causes_have_numbers() -> None:
    rng = np.random.default_rng(3)
    columns = rng.standard_normal((ROWS, COLUMNS))
    gram = gram_of(columns @ np.linspace(0.5, 1.0, COLUMNS), columns)
    assert len(taken_from(gram, gram.groups[0], np.ones(COLUMNS, dtype=bool), np.zeros(COLUMNS))) == MOST


def test_a_column_that_is_something_else_in_other_words_is_told() -> None:
    rng = np.random.default_rng(4)
    columns = rng.standard_normal((ROWS, COLUMNS))
    own = columns[:, [5]] + 0.02 * rng.standard_normal((ROWS, 1))
    gram = gram_of(rng.standard_normal(ROWS), columns, own)
    other = other_than(gram, gram.groups[0], gram.groups[1:], 0.003)
    assert np.flatnonzero(~other).tolist() == [5]
