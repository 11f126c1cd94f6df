"""Inner products instead of columns: what rounding leaves of columns that are all but the same must do no harm."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.search.gram import Gram


def gram_of(columns: np.ndarray, one_sided: bool) -> Gram:
    """A residual, one knob, and one candidate of all further columns."""
    group = np.arange(2, columns.shape[1])
    return Gram(columns.T @ columns, 1, (group,), (one_sided,), columns.shape[0], True)


def test_columns_that_differ_by_rounding_count_once() -> None:
    """A saturation looks alike at two limits beside a command that knows two values, and a knob does nearly the same.

    What is beside the knob is 1e-5 of the columns, so its square is known to 1e-16 / 1e-10, a millionth; the ridge
    against that rounding (1e-14 / 1e-10) takes a ten-thousandth, and twice that of two columns.
    """
    for seed in range(40):
        rng = np.random.default_rng(seed)
        knob, beside, noise = rng.standard_normal((3, 5000))
        beside -= knob * (knob @ beside) / (knob @ knob)
        residual = noise + 0.2 * beside
        twins = [knob + 1e-5 * beside * (1.0 + d) for d in (0.0, 1e-12 * seed)]
        truth = (residual @ beside) ** 2 / (beside @ beside)
        for one_sided in (False, True):
            gram = gram_of(np.column_stack([residual, knob, *twins]), one_sided)
            drop, sizes = gram.solve(gram.without(gram.knob_columns()), [0])
            assert abs(drop / truth - 1.0) < 1e-3
            assert np.isfinite(sizes).all()


def test_a_whole_candidate_counts_as_it_is() -> None:
    """Half of a rounding's pattern is that of a step not far away, a tenth of it is no rounding."""
    rng = np.random.default_rng(7)
    noise, pattern = rng.standard_normal((2, 50_000))
    for share, explained in ((0.9, True), (0.5, True), (0.1, False)):
        columns = np.column_stack([noise + share * pattern, rng.standard_normal(50_000), pattern])
        free = gram_of(columns, True)
        whole = Gram(free.products, 1, free.groups, (True,), free.rows, True, (True,))
        drop, sizes = whole.solve(whole.without(whole.knob_columns()), [0])
        # what a free part explains: 500 at a tenth, known to twice its square root
        found = free.solve(free.without(free.knob_columns()), [0])[0]
        assert found > 400.0
        assert drop == (pytest.approx(found, rel=0.01) if explained else 0.0)
        assert abs(sizes[0] - (share if explained else 0.0)) < 0.02
