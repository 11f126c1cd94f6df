"""The tests of the campaign as plans. PLANS is the only list: adding a plan is one file and one line here."""

from __future__ import annotations

from typing import Any

from campaigns.plans.base import Estimate, Plan, checked_segments, estimate
from campaigns.plans.chop import ChopPlan
from campaigns.plans.sinesweep import SineSweep
from sim_backend.errors import ConfigError

PLANS: dict[str, type[Plan]] = {
    plan.name: plan
    for plan in (
        ChopPlan,
        SineSweep,
    )
}


def make_plan(name: str, settings: dict[str, Any]) -> Plan:
    """Return the plan `name` with `settings`; raises ConfigError naming the plans or settings that there are."""
    if name not in PLANS:
        raise ConfigError(f"there is no plan '{name}'; plans: {', '.join(sorted(PLANS))}")
    return PLANS[name].of(settings)


__all__ = ["PLANS", "Estimate", "Plan", "checked_segments", "estimate", "make_plan"]
