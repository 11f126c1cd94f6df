"""Inner products instead of columns, against least squares and chi-squared.

What rounding leaves of columns that are all but the same must do no harm.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.search.gram import Gram, beside_start


def gram_of(columns: np.ndarray, one_sided: bool) -> Gram:
    """A residual, one nuisance, and one candidate of all further columns."""
    group = np.arange(2, columns.shape[1])
    return Gram(columns.T @ columns, 1, (group,), (one_sided,), columns.shape[0], True)


def test_columns_that_differ_by_rounding_count_once() -> None:
    """A saturation looks alike at two limits beside a command that knows two values, and a nuisance does nearly the
    same.

    What is beside the nuisance is 1e-5 of the columns, so its square is known to 1e-16 / 1e-10, a millionth; the ridge
    against that rounding (1e-14 / 1e-10) takes a ten-thousandth, and twice that of two columns.
    """
    for seed in range(40):
        rng = np.random.default_rng(seed)
        nuisance, beside, noise = rng.standard_normal((3, 5000))
        beside -= nuisance * (nuisance @ beside) / (nuisance @ nuisance)
        residual = noise + 0.2 * beside
        twins = [nuisance + 1e-5 * beside * (1.0 + d) for d in (0.0, 1e-12 * seed)]
        truth = (residual @ beside) ** 2 / (beside @ beside)
        for one_sided in (False, True):
            gram = gram_of(np.column_stack([residual, nuisance, *twins]), one_sided)
            drop, sizes = gram.solve(gram.without(gram.nuisance_columns()), [0])
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
        drop, sizes = whole.solve(whole.without(whole.nuisance_columns()), [0])
        # what a free part explains: 500 at a tenth, known to twice its square root
        found = free.solve(free.without(free.nuisance_columns()), [0])[0]
        assert found > 400.0
        assert drop == (pytest.approx(found, rel=0.01) if explained else 0.0)
        assert abs(sizes[0] - (share if explained else 0.0)) < 0.02


def test_likelihood_ratios_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(3)
    n = 300
    nuisances, columns = rng.standard_normal((n, 2)), rng.standard_normal((n, 3))
    residual = columns @ [0.5, 0.0, -0.2] + nuisances @ [3.0, 1.0] + rng.standard_normal(n)
    table = np.column_stack([residual, nuisances, columns])
    gram = Gram(table.T @ table, 2, (np.array([3]), np.array([4, 5])), (False, False), n, True)
    reduced = gram.without(gram.nuisance_columns())

    def rss(*parts: np.ndarray) -> float:
        x = np.column_stack(parts)
        return float(np.linalg.lstsq(x, residual, rcond=None)[1][0])

    for i, own in enumerate((columns[:, :1], columns[:, 1:])):
        drop, sizes = gram.solve(reduced, [i])
        assert drop == pytest.approx(rss(nuisances) - rss(nuisances, own), rel=1e-6)
        expected = np.linalg.lstsq(np.column_stack([nuisances, own]), residual, rcond=None)[0][2:]
        np.testing.assert_allclose(sizes, expected, rtol=1e-6)


def test_one_sided_sizes_stay_positive() -> None:
    rng = np.random.default_rng(4)
    column = rng.standard_normal(200)
    table = np.column_stack([-2.0 * column + rng.standard_normal(200), column])
    gram = Gram(table.T @ table, 0, (np.array([1]),), (True,), 200, True)
    drop, sizes = gram.solve(gram.without(gram.nuisance_columns()), [0])
    assert drop == pytest.approx(0.0, abs=1e-9)
    assert sizes[0] == pytest.approx(0.0, abs=1e-12)


def test_false_alarms_come_as_often_as_the_threshold_says() -> None:
    rng = np.random.default_rng(5)
    n, groups = 400, 12
    columns = rng.standard_normal((n, groups)) + rng.standard_normal((n, 1))  # strongly correlated candidates
    index = tuple(np.array([1 + i]) for i in range(groups))
    alarms = 0
    trials = 400
    table = np.column_stack([np.zeros(n), columns])
    gram = Gram(table.T @ table, 0, index, (False,) * groups, n, True)
    threshold = np.quantile(gram.null_ratios(gram.products, np.random.default_rng(6), 4000).max(axis=0), 0.95)
    for _ in range(trials):
        noise = np.column_stack([rng.standard_normal(n), columns])
        products = noise.T @ noise
        trial = Gram(products, 0, index, (False,) * groups, n, True)
        drops = np.array([trial.solve(products, [i])[0] for i in range(groups)])
        alarms += bool(np.max(trial.ratios(drops, products[0, 0])) > threshold)
    # 5 % of 400: binomial standard deviation 4.4, with the threshold's own error (4000 draws) 4.6; four of them
    assert 20 - 18 <= alarms <= 20 + 18


def test_a_column_that_the_nuisances_span_leaves_the_threshold_alone() -> None:
    rng = np.random.default_rng(8)
    nuisance, free, residual = rng.standard_normal((3, 400))
    spanned = 2.0 * nuisance + 1e-8 * rng.standard_normal(400)  # 1e-16 of its energy is left: rounding
    columns = np.stack([residual, nuisance, free, spanned], axis=1)
    gram = Gram(columns.T @ columns, 1, (np.array([2]), np.array([3])), (False, False), 400, True)
    maxima = gram.null_ratios(gram.without(gram.nuisance_columns()), np.random.default_rng(0), 4000).max(axis=0)
    # one live column: chi-squared with one degree of freedom, 99 % below 6.63; 4000 draws know that to 0.35
    assert np.quantile(maxima, 0.99) == pytest.approx(6.635, abs=1.1)


def test_products_that_rounding_left_not_positive_do_no_harm() -> None:
    """Beside a motion that grows without end three columns are one, and their products differ by rounding alone."""
    rng = np.random.default_rng(5)
    noise, slow = rng.standard_normal(4000), np.arange(4000.0) ** 3
    gram = gram_of(np.column_stack([noise + 1e-9 * slow, np.ones(4000), slow, slow, slow]), True)
    products = gram.products.copy()
    products[2:, 2:] -= (
        1e-6 * products[2, 2] * (np.ones((3, 3)) - np.eye(3)) * np.array([[0, 1, -1], [1, 0, 1], [-1, 1, 0]])
    )
    bent = replace(gram, products=products)
    drop, sizes = bent.solve(products, [0])
    truth = (noise + 1e-9 * slow) @ slow / np.linalg.norm(slow)
    assert abs(drop / truth**2 - 1.0) < 1e-3
    assert np.all(sizes >= 0.0)


def test_a_column_that_is_a_start_and_nothing_else_leaves_nothing() -> None:
    """What rounding leaves of it is of either sign, and beside it any other column would be endlessly large."""
    signs = set()
    for seed in range(40):
        rng = np.random.default_rng(seed)
        start = np.linalg.qr(rng.standard_normal((4000, 4)))[0]
        is_start = 1e7 * start @ rng.standard_normal((4, 2))
        columns = np.column_stack([rng.standard_normal((4000, 3)), is_start])
        seen = start.T @ columns
        products = columns.T @ columns
        signs |= set(np.sign(np.diag(products - seen.T @ seen)[3:]).tolist())
        left = beside_start(products, seen)
        assert not left[3:].any() and not left[:, 3:].any()
        free = columns[:, :3] - start @ seen[:, :3]
        np.testing.assert_allclose(left[:3, :3], free.T @ free, rtol=1e-9, atol=1e-9)
        gram = Gram(left, 0, (np.array([1, 2, 3, 4]),), (False,), 4000, True)
        gain, ways = gram.fresh(left, gram.groups[0], 1e-4)
        inner, seen_by = left[1:3, 1:3], left[1:3, 0]
        assert ways == 2 and gain == pytest.approx(seen_by @ np.linalg.solve(inner, seen_by), rel=1e-9)
    assert {-1.0, 1.0} <= signs


@pytest.mark.parametrize("known_noise", [True, False])
def test_a_visible_size_is_seen_in_half_of_all_cases(known_noise: bool) -> None:
    """At the size that is told the ratio that was asked for is reached as often as not, a nuisance re-tuned beside
    it."""
    rng = np.random.default_rng(11)
    asked, n = 30.0, 2000
    nuisance, column = rng.standard_normal((2, n))
    column += 0.8 * nuisance
    reached = 0
    for _ in range(300):
        noise = rng.standard_normal(n)
        empty = np.column_stack([noise, nuisance, column])
        gram = replace(gram_of(empty, False), known_noise=known_noise)
        (size,) = gram.seen(gram.without(gram.nuisance_columns()), 0, asked)
        there = np.column_stack([noise + size * column, nuisance, column])
        full = replace(gram_of(there, False), known_noise=known_noise)
        reduced = full.without(full.nuisance_columns())
        reached += full.ratios(np.array([full.solve(reduced, [0])[0]]), float(reduced[0, 0]))[0] > asked
    # the ratio is that of a normal number of unit variance about the root of what was asked: a little above half
    assert 0.42 < reached / 300 < 0.62


def test_what_a_nuisance_does_as_well_is_never_visible() -> None:
    rng = np.random.default_rng(5)
    noise, nuisance = rng.standard_normal((2, 500))
    gram = gram_of(np.column_stack([noise, nuisance, 2.0 * nuisance]), False)
    assert np.isinf(gram.seen(gram.without(gram.nuisance_columns()), 0, 20.0)).all()
