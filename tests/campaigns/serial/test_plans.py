"""Every plan of a whole campaign runs unchanged at the end of a line, and its records are the same bit for bit."""

from __future__ import annotations

import contextlib

import pytest

from campaigns.benches import open_bench
from campaigns.plans import PLANS, checked_segments, make_plan
from campaigns.playing.campaign import load_campaign
from tests.campaigns.serial.conftest import differences

RUNS = load_campaign("quick").plans() | {"rest": make_plan("rest", {"duration_s": 0.5, "settle_s": 0.1})}


def test_no_plan_is_left_out() -> None:
    assert {plan.name for plan in RUNS.values()} == set(PLANS)


@pytest.mark.parametrize("name", RUNS)
def test_a_plan_on_the_emulated_bench(name: str) -> None:
    with (
        contextlib.closing(open_bench("emulator", 4)) as emulated,
        contextlib.closing(open_bench("sim", 4)) as simulated,
    ):
        pairs = zip(checked_segments(RUNS[name], emulated), checked_segments(RUNS[name], simulated), strict=True)
        for there, here in pairs:
            assert differences(emulated.play(there), simulated.play(here)) == [], here.label
