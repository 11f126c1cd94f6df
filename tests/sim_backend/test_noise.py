"""Noise is what numpy would have drawn, bit for bit, and leaves the generator where numpy would."""

import numpy as np
import pytest

from sim_backend.errors import ConfigError
from sim_backend.noise import Normals, standard_normal


@pytest.mark.parametrize("seed", range(5))
def test_the_numbers_are_those_of_numpy(seed):
    ours, numpys = np.random.default_rng(seed), np.random.default_rng(seed)
    # lengths of nothing, one and many; of a million numbers some 270 come from beyond 3.65 standard deviations
    for n in (0, 1, 2, 999, 1_000_000):
        np.testing.assert_array_equal(standard_normal(n, ours), numpys.standard_normal(n))
    assert ours.bit_generator.state == numpys.bit_generator.state


def test_the_generator_may_be_used_otherwise_between():
    ours, numpys = np.random.default_rng(3), np.random.default_rng(3)
    for _ in range(3):
        assert ours.integers(0, 100, dtype=np.uint32) == numpys.integers(0, 100, dtype=np.uint32)
        np.testing.assert_array_equal(standard_normal(101, ours), numpys.standard_normal(101))


def test_another_generator_draws_by_itself():
    ours, numpys = (np.random.Generator(np.random.SFC64(1)) for _ in range(2))
    np.testing.assert_array_equal(standard_normal(1000, ours), numpys.standard_normal(1000))


@pytest.mark.parametrize("generator", [np.random.PCG64, np.random.SFC64])
def test_what_is_given_is_filled_and_nothing_beside_it(generator):
    ours, numpys = (np.random.Generator(generator(7)) for _ in range(2))
    table = np.zeros((3, 500))
    filled = standard_normal(500, ours, out=table[1])
    np.testing.assert_array_equal(table[1], numpys.standard_normal(500))
    assert filled.base is table and not table[[0, 2]].any()
    column = np.zeros((500, 2))
    standard_normal(500, ours, out=column[:, 1])
    np.testing.assert_array_equal(column[:, 1], numpys.standard_normal(500))
    with pytest.raises(ConfigError, match=r"shape \(3, 500\); 500 numbers need \(500,\)"):
        standard_normal(500, ours, out=table)


@pytest.mark.parametrize("generator", [np.random.PCG64, np.random.SFC64])
def test_several_generators_go_on_from_block_to_block(generator):
    ours, numpys = ([np.random.Generator(generator(seed)) for seed in range(4)] for _ in range(2))
    normals = Normals(ours)
    for n in (1, 0, 10_000, 999):
        np.testing.assert_array_equal(normals.next(n), [one.standard_normal(n) for one in numpys])


def test_of_no_generator_there_is_nothing():
    assert Normals([]).next(5).shape == (0, 5)
