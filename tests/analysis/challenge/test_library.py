"""The two simulators, written apart, mean the same by a name: sign, unit and place of every effect that both state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from analysis.challenge.campaign import Campaign
from analysis.challenge.families import FAMILIES, slugs
from analysis.challenge.families.hysteresis import BoucWen, DriveHysteresis, Iwan, JilesAtherton
from analysis.challenge.families.sensor import FringeJump
from analysis.challenge.families.structure import EndStop, Friction
from analysis.challenge.families.surroundings import ThermalStiffness, VibrationLine
from analysis.challenge.plant import AXES, nominal_model
from sim_backend.bench import Segment
from sim_backend.effects import EFFECTS
from sim_backend.model import EffectEntry
from sim_backend.simbench import SimBench

# what the truth leaves open is filled in as the library would fit it
OPEN = {
    EndStop: lambda e: {"damping": e.size * e.loss_s},
    Friction: lambda e: {"breakaway_rate": 1e-3},
    FringeJump: lambda e: {"rate_limit": e.limit},
}

# Not compared: chance and rounding; hysteresis, whose forms differ on purpose; a vibration, whose phase is each run's
# own; and the thermal drift, as a simulated bench without hardware has no temperature (see test_bench for its sign)
LEFT_OUT = (BoucWen, DriveHysteresis, Iwan, JilesAtherton, ThermalStiffness, VibrationLine)
STATED = [f for f in FAMILIES if not f.random and f.smooth and f not in LEFT_OUT]

# Share of the signature that may be left: the library's grid is eight times coarser, so corners and jumps are passed up
# to a sample early or late, and sharp friction is smoothed where the hidden bristles give; all else agrees to a few per
# cent.
ROUGH = {"coulomb-friction": 0.3, "fringe-jump": 0.3, "end-stop-contact": 0.1, "backlash": 0.1}


def test_every_cause_of_the_library_can_be_hidden() -> None:
    assert set(slugs()) == {effect.reported() for effect in EFFECTS}


@pytest.mark.parametrize("family", STATED, ids=lambda f: f.__name__)
def test_library_reproduces_the_hidden_effect(family, short_two: Campaign) -> None:
    campaign = replace(short_two, starts=tuple(np.zeros_like(s) for s in short_two.starts))
    scene = campaign.scene()
    effect = family.draw(np.random.default_rng(3), scene)
    run, silence = campaign.runs[0], [np.zeros_like(n) for n in campaign.noise()]
    (with_it,), (without,) = campaign.readings((effect,), silence), campaign.readings((), silence)
    model = nominal_model(campaign.plant, np.random.default_rng(0), run.excitation.rate_hz, error=0.0)
    parameters = {**effect.truth(), **OPEN.get(family, lambda e: {})(effect)}
    played = Segment("all", run.excitation.n, np.zeros_like(run.excitation.command), run.excitation.command)

    def library(entries: list[EffectEntry]) -> np.ndarray:
        record = SimBench(structs.replace(model, effects=entries), 0).play(played).channels
        return np.stack([record[axis] for axis in AXES], axis=1)

    entry = EffectEntry(effect=effect.slug, where=effect.where, parameters=parameters)
    hidden, theirs = with_it - without, library([entry]) - library([])
    assert np.linalg.norm(hidden) > 0.0
    assert np.linalg.norm(hidden - theirs) < ROUGH.get(effect.slug, 0.05) * np.linalg.norm(hidden)
