"""Segments are checked wherever their waveforms differ from those before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from campaigns.plans import checked_segments, estimate
from campaigns.plans.base import Plan
from sim_backend.bench import Segment
from sim_backend.errors import ConfigError
from sim_backend.simbench import SimBench
from tests.small_bench import bench_model


class Cut(Plan, frozen=True, kw_only=True):
    """Three segments, the second of the first's waveforms, the third with `third` times its input."""

    name = "cut"
    title = "cut"
    third: float = 1.0

    def segments(self, bench):
        channels = self.channels(bench)
        first = Segment("first", 10, np.zeros((10, 3)), np.full((10, 3), 0.01), record=channels)
        yield first
        yield replace(first, label="second")
        yield replace(first, label="third", feedforward=self.third * first.feedforward)


def test_waveforms_that_change_are_checked_again():
    bench = SimBench(bench_model(), 0)
    single, twice = (estimate(Cut(third=third), bench).peak_current_a for third in (1.0, 2.0))
    assert twice == pytest.approx(2.0 * single, rel=1e-12)
    with pytest.raises(ConfigError, match="'third': feed-forward asks for"):
        list(checked_segments(Cut(third=1e3), bench))
