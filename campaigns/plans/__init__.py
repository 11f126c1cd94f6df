"""The tests of the campaign as plans. PLANS is the only list: adding a plan is one file and one line here."""

from __future__ import annotations

from typing import Any

from campaigns.plans.base import Estimate, Plan, checked_segments, estimate
from campaigns.plans.chop import ChopPlan
from campaigns.plans.endstops import EndStops
from campaigns.plans.freerun import FreeRun
from campaigns.plans.hysteresis import Hysteresis
from campaigns.plans.multisine import Multisine
from campaigns.plans.rest import Rest
from campaigns.plans.settling import Settling
from campaigns.plans.sinesweep import SineSweep
from campaigns.plans.theodolite import Theodolite
from campaigns.plans.thermal import Thermal
from sim_backend.errors import ConfigError, did_you_mean

PLANS: dict[str, type[Plan]] = {
    plan.name: plan
    for plan in (
        ChopPlan,
        EndStops,
        FreeRun,
        Hysteresis,
        Multisine,
        Rest,
        Settling,
        SineSweep,
        Theodolite,
        Thermal,
    )
}


def make_plan(name: str, settings: dict[str, Any]) -> Plan:
    """Return the plan `name` with `settings`; raises ConfigError naming the plans or settings that there are."""
    if name not in PLANS:
        raise ConfigError(f"there is no plan '{name}'; {did_you_mean(name, PLANS)}plans: {', '.join(sorted(PLANS))}")
    return PLANS[name].of(settings)


__all__ = ["PLANS", "Estimate", "Plan", "checked_segments", "estimate", "make_plan"]
