"""Roundings whose step the readings themselves show: it is taken from them, and no longer fitted.

Quantised readings show their step to a millionth. A fit sees the sawtooth that the steps make, whose misfit has cusps
over the step, and ends beside the lowest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.balance import again, score
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.records.lattice import Lattice
from sim_backend.effects.base import Effect
from sim_backend.effects.sensor_quantisation import SensorQuantisation

_NEAR = 1e-3
"""Relative distance within which a fitted step is that of the readings: the sawtooth of another is another."""


def with_recorded_steps(setting: Setting, fit: Fit, lattices: Mapping[str, Lattice]) -> Fit:
    """Return `fit` with its quantisation steps as seen in the readings, unless the evidence is then worse.

    `lattices` holds the steps seen, by output.
    """
    pairs = [
        _recorded(candidate, effect, lattices) for candidate, effect in zip(fit.candidates, fit.effects, strict=True)
    ]
    candidates, effects = tuple(c for c, _ in pairs), tuple(e for _, e in pairs)
    if candidates == fit.candidates:
        return fit
    told = again(setting, replace(fit, candidates=candidates, effects=effects))
    known = setting.whitener.repeats
    return told if score(told, known) <= score(fit, known) else fit


def _recorded(candidate: Candidate, effect: Effect, lattices: Mapping[str, Lattice]) -> tuple[Candidate, Effect]:
    lattice = lattices.get(effect.where)
    if candidate.told or lattice is None or not isinstance(effect, SensorQuantisation):
        return candidate, effect
    if abs(effect.step_size - lattice.step) > _NEAR * lattice.step:
        return candidate, effect
    own = replace(candidate, shapes={"step_size": lattice.step}, told={"step_size": lattice.std})
    return own, replace(effect, step_size=lattice.step)
