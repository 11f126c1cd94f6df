"""Readings cut off at the end of a range, told from rests, steps and turns."""

import numpy as np
import pytest

from campaigns.facts.clipping import saturation

T = np.arange(20_000) / 1000.0
SINE = np.sin(2.0 * np.pi * 3.0 * T)


@pytest.mark.parametrize("cut", [0.95, 0.7, 0.2])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_clipped_sine_is_cut_off_for_the_share_of_time_it_would_be_beyond(cut, noise):
    noisy = SINE + noise * np.random.default_rng(0).standard_normal(T.size)
    ((share, level),) = saturation(np.minimum(noisy, cut))
    # a sine is above `cut` for arccos(cut)/pi of the time; noise breaks up the ends of each stay
    assert share == pytest.approx(np.arccos(cut) / np.pi, rel=0.1)
    assert level == cut


def test_the_lower_limit_counts_as_well():
    ((share, level),) = saturation(np.maximum(SINE, -0.5))
    assert level == -0.5 and share > 0.3


def test_the_same_value_elsewhere_is_no_limit():
    assert saturation(np.where(np.abs(SINE) < 0.1, 0.0, SINE)) == []


@pytest.mark.parametrize("step", [0.5, 0.05, 1e-3])
def test_coarse_resolution_is_no_limit(step):
    ends = saturation(step * np.round(SINE / step))
    assert ends == [] or step == 0.5  # four levels in all: nobody can tell


def test_a_rest_before_a_smooth_start_is_no_limit():
    rest = np.concatenate([np.zeros(5000), 1.0 - np.cos(2.0 * np.pi * 3.0 * T[:10_000])])
    assert saturation(rest) == []


def test_a_constant_channel_has_no_limit():
    assert saturation(np.ones(100)) == []
