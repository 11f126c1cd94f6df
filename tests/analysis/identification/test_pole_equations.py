"""The compiled steps of vector fitting against the matrices and functions that they stand for."""

import numpy as np
import pytest

from analysis.identification.pole_equations import companion, reduced, settled

PAIRS = np.array([-0.02 + 0.3j, -0.02 - 0.3j, -0.1 + 0.9j, -0.1 - 0.9j, -0.4, -0.05])


def fractions(point, poles):
    """Columns (n_f, n): both of a pair by their sum and j times their difference, real poles by themselves."""
    columns: list[np.ndarray] = []
    for k, pole in enumerate(poles):
        if pole.imag < 0.0:
            before = 1.0 / (point - poles[k - 1])
            columns[-1:] = [before + 1.0 / (point - pole), 1j * (before - 1.0 / (point - pole))]
        else:
            columns.append(1.0 / (point - pole))
    return np.transpose(columns)


@pytest.mark.parametrize("lines", [40, 64, 301])
@pytest.mark.parametrize("feedthrough", [True, False])
@pytest.mark.parametrize("moving", [True, False])
def test_a_triangle_has_the_products_of_its_columns(rng, lines, feedthrough, moving):
    point = 1j * np.geomspace(0.01, 1.0, lines)
    data = rng.normal(size=(lines, 2)) + 1j * rng.normal(size=(lines, 2))
    weights = rng.uniform(0.5, 2.0, (lines, 2))
    triangles, sums = reduced(point, data, weights, PAIRS, feedthrough, moving)
    basis = fractions(point, PAIRS)
    np.testing.assert_allclose(sums, [*basis.real.sum(axis=0), lines], rtol=1e-13)
    for e, triangle in enumerate(triangles):
        one = np.ones((lines, 1))
        model = np.hstack([basis, one]) if feedthrough else basis
        sigma = -data[:, e, None] * (np.hstack([basis, one]) if moving else one)
        columns = weights[:, e, None] * np.hstack([model, sigma])
        products = (columns.conj().T @ columns).real
        size = np.sqrt(np.diag(products))
        assert np.array_equal(triangle, np.triu(triangle))
        # each of up to 301 terms is rounded by 1e-16 of the columns' lengths
        np.testing.assert_allclose(
            triangle.T @ triangle / np.outer(size, size), products / np.outer(size, size), atol=1e-13
        )


def test_the_next_poles_are_the_zeros_of_sigma(rng):
    sigma = rng.normal(size=PAIRS.size + 1)
    matrix, finite = companion(PAIRS, sigma)
    assert finite and not companion(PAIRS, sigma * np.nan)[1]
    zeros = np.linalg.eigvals(matrix)
    values = fractions(zeros, PAIRS) @ sigma[:-1] + sigma[-1]
    # rounding of the terms that cancel, and of zeros of size one, where sigma's slope is some 10 / 0.02 at most
    assert np.max(np.abs(values)) < 1e-11


@pytest.mark.parametrize("sampled", [False, True])
def test_poles_are_stable_and_paired(sampled):
    found = np.array([0.3 + 0.2j, 0.3 - 0.2j, -0.5, 1.2, 0.9 + 1j, 0.9 - 1j, 0.1j, -0.1j])
    poles, change = settled(found.real, found.imag, found, sampled)
    assert np.all(np.abs(poles) < 1.0) if sampled else np.all(poles.real < 0.0)
    np.testing.assert_array_equal(poles[1:6:2], poles[0:6:2].conj())
    assert np.all(poles[0:6:2].imag > 0.0) and np.all(poles[6:].imag == 0.0)
    mirrored = (
        np.where(np.abs(found) > 1.0, 1.0 / found.conj(), found) if sampled else -np.abs(found.real) + 1j * found.imag
    )
    # on the border by a billionth at most
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(mirrored), rtol=2e-9)
    rest = 1.0 if sampled else 0.0
    moved = np.abs(np.sort_complex(poles) - np.sort_complex(found)) / np.abs(np.sort_complex(poles) - rest)
    assert change == pytest.approx(np.max(moved), rel=1e-12)
