"""Cross-coupling: the drive of one axis pushes another as well."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Aux, Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return p[0] * aux


@dataclass(frozen=True)
class CrossCoupling(Effect):
    """Command of the target plus gain · command of the source; `where` is "source->target".

    It acts at the command, so that the target's delay and amplifier act on it too.
    """

    name = "cross-coupling"
    family = "structure"
    site = Site.COMMAND
    exact = True
    linear_form = True
    symptom = "follows the command of another axis, in proportion"
    aux = Aux.SOURCE_COMMAND
    step = _step

    gain: float = size("share of the source's command that reaches the target")
