"""Effects are connected once for all benches that differ in numbers alone, and no bench sees another's numbers."""

import msgspec
import numpy as np
import pytest

from sim_backend import wiring
from sim_backend.assembly import places_of
from sim_backend.effects import make_effect
from sim_backend.errors import ConfigError
from sim_backend.model import EffectEntry, load_model
from sim_backend.simbench import SimBench
from sim_backend.wiring import effects_of
from tests.sim_backend.test_kernel import one_axis


def arrays(size, places):
    return effects_of([make_effect("cubic-stiffness", "theta_x", {"stiffness": size})], places)[0]


def test_benches_that_differ_in_numbers_alone_are_connected_once(monkeypatch):
    asked = []
    connect = wiring._batches  # noqa: SLF001

    def connecting(acting):
        asked.append(len(acting))
        return connect(acting)

    monkeypatch.setattr(wiring, "_batches", connecting)
    wiring._connected.cache_clear()  # noqa: SLF001
    model = load_model("as-built")
    other = msgspec.structs.replace(model, modes=model.modes[::-1], name="another")
    for one in (model, other):
        SimBench(one, 1)
    # delays and modes change the linear model, amplifiers without a lag and a ground that stands still are left out
    apart = ("delay", "extra-resonance", "amplifier-lag", "broadband-vibration", "vibration-line")
    assert asked == [sum(e.effect not in apart for e in model.effects)]


def test_what_is_left_out_has_its_place_all_the_same():
    model = load_model("as-built")
    for name, size in (("amplifier-lag", "time_constant_s"), ("broadband-vibration", "rms")):
        stray = EffectEntry(effect=name, where="a4", parameters={size: 0.0})
        with pytest.raises(ConfigError, match=f"{name}: there is no 'a4' on this bench"):
            SimBench(msgspec.structs.replace(model, effects=[*model.effects, stray]), 1)


def test_what_a_bench_changes_stays_its_own():
    places = places_of(one_axis())
    first, second = arrays(1.0, places), arrays(2.0, places)
    first.parameters[0] = first.cells[0] = 7.0
    first.aux[0], first.column[0] = 1, 5
    third = arrays(2.0, places)
    for found in (second, third):
        assert (found.parameters[0], found.cells[0], found.aux[0], found.column[0]) == (2.0, 0.0, 0, -1)


def test_places_are_known_by_what_they_are():
    model = load_model("as-built")
    assert places_of(model) == places_of(load_model("as-built"))
    moved = msgspec.to_builtins(model)
    moved["hardware"]["sensors"]["radius_m"] = 0.031
    assert places_of(msgspec.convert(moved, type(model))) != places_of(model)


def test_an_effect_on_a_mode_follows_the_numbers_of_the_mode():
    levers = []
    for frequency_hz in (20.0, 30.0):
        model = one_axis(frequency_hz=frequency_hz)
        effect = make_effect("cubic-stiffness", "mode 1", {"stiffness": 1.0})
        levers.append(effects_of([effect], places_of(model), model.linear())[0].levers)
    assert np.any(levers[0] != levers[1])


def test_a_place_that_is_not_there_is_told_every_time():
    entry = EffectEntry(effect="cubic-stiffness", where="elsewhere", parameters={"stiffness": 1.0})
    model = msgspec.structs.replace(load_model("as-built"), effects=[entry])
    for _ in range(2):
        with pytest.raises(ConfigError, match="elsewhere"):
            SimBench(model, 1)
