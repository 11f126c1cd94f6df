"""What every plan promises as a possible next experiment: within reach, of one form at any size, and told in full."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest

from campaigns.plans import PLANS, checked_segments, make_plan
from campaigns.plans.base import Reach
from sim_backend.simbench import SimBench
from tests.small_bench import bench_model


@pytest.fixture(scope="module")
def bench():
    model = bench_model()
    assert model.hardware is not None
    return SimBench(
        msgspec.structs.replace(model, hardware=msgspec.structs.replace(model.hardware, theodolite_noise_rad=2.5e-6)), 0
    )


REACH = Reach(("theta_x", "z"), np.array([0.05, 0.0, 0.2]))


@pytest.mark.parametrize("name", sorted(PLANS))
def test_an_offer_keeps_to_the_axes_and_the_size_asked_for(name, bench):
    for plan in PLANS[name].offers(bench, REACH):
        # a multisine is scaled by its usual peak factor, which a draw of phases may exceed by some per cent
        most = 1.25 * REACH.command
        for segment in checked_segments(plan, bench):
            assert np.all(np.max(np.abs(segment.feedforward), axis=0) <= most), segment.label
            assert segment.n_samples <= 200_000


@pytest.mark.parametrize("name", sorted(PLANS))
def test_offers_are_the_same_forms_at_any_size(name, bench):
    large, small = (list(PLANS[name].offers(bench, REACH.scaled(level))) for level in (1.0, 0.1))
    assert len(large) == len(small)
    for one, other in zip(large, small, strict=True):
        differs = {k for k, v in one.settings().items() if v != other.settings()[k]}
        assert all("torque" in k or "force" in k for k in differs)


@pytest.mark.parametrize("name", sorted(PLANS))
def test_what_an_offer_changes_makes_it_again(name, bench):
    for plan in PLANS[name].offers(bench, REACH):
        changes = json.loads(json.dumps(plan.changes()))
        assert make_plan(name, changes) == plan
        assert all(getattr(plan, key) != getattr(make_plan(name, {}), key) for key in changes)


def test_sizes_are_round_numbers():
    assert Reach(("theta_x",), np.array([0.0512345, 0.0])).scaled(0.5).command.tolist() == [0.026, 0.0]


def test_only_plans_that_record_motion_or_an_instrument_are_offered(bench):
    assert {name for name, plan in PLANS.items() if list(plan.offers(bench, REACH))} == {
        "freerun",
        "hysteresis",
        "multisine",
        "theodolite",
    }
    without = SimBench(bench_model(), 0)
    assert list(PLANS["theodolite"].offers(without, REACH)) == []
