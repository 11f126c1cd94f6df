"""The experiment that an investigation starts with: as much motion as the bench allows, and periods that repeat."""

from __future__ import annotations

import msgspec
import numpy as np

from analysis.diagnosis.experiment.planned import LEVELS, Room, play_on_paper, reach_of
from campaigns.plans import Plan
from campaigns.plans.base import rate_of
from campaigns.plans.multisine import Multisine
from sim_backend.assembly import places_of, retuned
from sim_backend.bench import Bench
from sim_backend.effects import Aux, effect_class, make_effect
from sim_backend.errors import ConfigError
from sim_backend.model import Model, number


def first_plan(bench: Bench, model: Model) -> Plan:
    """Return a multisine on all axes that bench and `model` share: its repeated periods tell noise from motion.

    It has the largest amplitude that keeps the limits by `model`; on a bench that states none, the plan's own. Raises
    ConfigError when bench and model share no axis.
    """
    places = places_of(model)
    axes = tuple(axis for axis in bench.axes if axis in places.inputs)
    if not axes:
        raise ConfigError(
            f"the bench has the axes {', '.join(bench.axes)}, model '{model.name}' has {', '.join(places.inputs)}; "
            "give a model of this bench"
        )
    limits = dict(zip(bench.axes, bench.limits.reference.tolist(), strict=True))
    room = Room(np.array([limits.get(dof, np.inf) for dof in places.outputs]), float(bench.limits.current_a))
    usual = Multisine()
    own = np.array([usual.force_rms_n if axis == "z" else usual.torque_rms_nm for axis in places.inputs])
    effects = [
        make_effect(e.effect, e.where, {k: number(v) for k, v in e.parameters.items()})
        for e in model.effects
        if effect_class(e.effect).aux is not Aux.EXOGENOUS
    ]
    reach = reach_of(axes, bench, retuned(model.linear(), effects, places), places.inputs, room, 3.5 * own)
    kept = [e for e in model.effects if effect_class(e.effect).aux is not Aux.EXOGENOUS]
    quiet = msgspec.structs.replace(model, effects=kept, sample_rate_hz=rate_of(bench))
    for level in LEVELS:
        plan = next(iter(Multisine.offers(bench, reach.scaled(level))))
        if play_on_paper(plan, bench, quiet, room) is not None:
            return plan
    raise ConfigError(
        f"by model '{model.name}' no multisine keeps the bench's limits, not at {LEVELS[-1]:g} of its reach at rest; "
        "choose the first plan with --first and --set"
    )
