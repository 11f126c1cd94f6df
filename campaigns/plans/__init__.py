"""The tests of the campaign as plans. PLANS is the only list: adding a plan is one file and one line here.

Other packages may add to it (`sim_backend.plugins`): `all_plans` has theirs too.
"""

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
from sim_backend.plugins import load_plugin, plugin_names, refusal

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


def all_plans() -> dict[str, type[Plan]]:
    """Return PLANS and the plans of other packages by name.

    Raises ConfigError for one of a package that cannot be imported or is not a plan.
    """
    return PLANS | {name: _of_a_package(name) for name in plugin_names("plans", PLANS)}


def make_plan(name: str, settings: dict[str, Any]) -> Plan:
    """Return the plan `name` with `settings`; raises ConfigError naming the plans or settings that there are."""
    if name in PLANS:
        return PLANS[name].of(settings)
    known = (*PLANS, *plugin_names("plans", PLANS))
    if name not in known:
        raise ConfigError(f"there is no plan '{name}'; {did_you_mean(name, known)}plans: {', '.join(sorted(known))}")
    return _of_a_package(name).of(settings)


def _of_a_package(name: str) -> type[Plan]:
    """Return the plan that another package declares; raises ConfigError where it is not one."""
    found = load_plugin("plans", name)
    if not (isinstance(found, type) and issubclass(found, Plan)):
        raise refusal("plans", name, "is not a subclass of campaigns.plans.Plan")
    if getattr(found, "name", None) != name or not hasattr(found, "title"):
        raise refusal("plans", name, f"calls itself '{getattr(found, 'name', '')}', or has no title")
    return found


__all__ = ["PLANS", "Estimate", "Plan", "all_plans", "checked_segments", "estimate", "make_plan"]
