"""What a segment asks of a bench."""

from __future__ import annotations

import numpy as np
import pytest

from sim_backend.bench import Limits, Segment, check_segment


@pytest.mark.parametrize("period", [1, 7, 1000])
def test_a_demand_is_the_largest_of_every_axis_and_actuator(period):
    rng = np.random.default_rng(3)
    reference, feedforward, to_current = (rng.normal(size=size) for size in ((period, 3), (period, 3), (4, 3)))
    asked = check_segment(Segment("a", period, reference, feedforward), Limits(np.full(3, 1e3), 1e3, to_current))
    assert asked.reference.tolist() == [max(abs(x) for x in reference[:, axis]) for axis in range(3)]
    currents = [abs(to_current @ row) for row in feedforward]
    # the products may be added in another order
    assert asked.current_a == pytest.approx(np.max(currents), rel=1e-14)
