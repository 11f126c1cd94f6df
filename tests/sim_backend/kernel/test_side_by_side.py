"""A bench that is played in a lane beside others measures what it measures alone, to the last bit."""

import msgspec
import numpy as np
import pytest
from llvmlite import ir

from sim_backend import kernel
from sim_backend.assembly import stated
from sim_backend.bench import Gate, Record, Segment
from sim_backend.control.feedback import theta_controller, z_controller
from sim_backend.effects import BENCH_ONLY, NAMED, NOISES
from sim_backend.errors import ConfigError
from sim_backend.kernel import machine, side_by_side
from sim_backend.kernel.structure import LANES, Structure
from sim_backend.kernel.tables import AT_ONCE
from sim_backend.kernel.wide_step import wide_step
from sim_backend.model import EffectEntry, load_model
from sim_backend.simbench import SimBench, play_side_by_side
from tests.lanes import lanes_asked
from tests.sim_backend.kernel.test_loop import SIZES, STEPPED, N, closed
from tests.sim_backend.test_kernel import RATE_HZ, held_torque, one_axis

AS_BUILT = load_model("as-built")

SMALL = {"slow-softening": 1e-3, "magnetic-polynomial": 1e-4}
"""Sizes of effects that make a bench unstable where they are larger."""


@pytest.fixture
def lanes(monkeypatch):
    """How many benches every loop played that was asked for; those for several are made at once."""
    return lanes_asked(monkeypatch)


def drawn(model, k):
    """Bench `k` of those that differ in numbers: frequencies of modes and sizes of effects."""
    content = msgspec.to_builtins(model)
    for mode in content["modes"]:
        mode["frequency_hz"] = {"value": (1.0 + 2e-3 * k) * value_of(mode["frequency_hz"])}
    for effect in content["effects"]:
        for name, value in effect["parameters"].items():
            effect["parameters"][name] = (1.0 - 1e-3 * k) * value_of(value)
    return msgspec.convert(content, type(model))


def value_of(number):
    return number["value"] if isinstance(number, dict) else number


def assert_same(models, segments, lanes, **options):
    """Play on all benches at once and on each alone, and compare; return what they measured."""
    together = [SimBench(model, seed, **options) for seed, model in enumerate(models)]
    records = [play_side_by_side(together, segment) for segment in segments]
    assert LANES in lanes
    for seed, model in enumerate(models):
        bench = SimBench(model, seed, **options)
        for segment, found in zip(segments, records, strict=True):
            alone = bench.play(segment).channels
            record = found[seed]
            assert isinstance(record, Record)
            for name, values in record.channels.items():
                np.testing.assert_array_equal(values, alone[name], err_msg=f"bench {seed}, {segment.label}: {name}")
    return records


@pytest.mark.parametrize("substeps", (1, 3))
@pytest.mark.parametrize("benches", (LANES, 2 * LANES + 1))
def test_the_bench_as_built_learning_with_gates(lanes, substeps, benches):
    models = [drawn(AS_BUILT, k) for k in range(benches)]
    # the second run goes on from the states that the first one left
    records = assert_same(models, [closed(), closed()], lanes, substeps=substeps, truth=True)
    assert np.ptp(records[0][0].channels["theta_x"]) > 1e-3
    assert np.any(records[0][0].channels["theta_x"] != records[0][1].channels["theta_x"])


def test_a_run_of_any_length(lanes):
    # samples are brought together some at a time
    segments = [of_length(closed(), n) for n in (1, AT_ONCE - 1, AT_ONCE, AT_ONCE + 1, 3 * AT_ONCE + 5)]
    assert_same([drawn(AS_BUILT, k) for k in range(LANES)], segments, lanes)


def of_length(segment, n):
    return Segment(
        f"{n} samples", n, segment.reference, segment.feedforward, segment.feedback, segment.gates, segment.learning
    )


def test_every_effect(lanes):
    entries = []
    for cls in STEPPED:
        sizes = dict.fromkeys(cls.sizes(), SIZES.get(cls.name, 1e-6))
        source = "theta_y->" if cls.aux.name.startswith("SOURCE") else ""
        shapes = {p.name: 0.05 for p in cls.parameters() if not p.size and not (np.isfinite(p.neutral) and p.neutral)}
        entries.append(EffectEntry(effect=cls.name, where=f"{source}theta_x", parameters={**sizes, **shapes}))
    torque = np.stack([held_torque(N, seed) for seed in (1, 2, 3)], axis=1)
    models = [drawn(msgspec.structs.replace(AS_BUILT, effects=entries), k) for k in range(LANES)]
    assert_same(models, [Segment("open", N, np.zeros_like(torque), torque)], lanes, truth=True)


@pytest.mark.parametrize("entry", [pytest.param(cls, id=cls.name) for cls in STEPPED if "SOURCE" not in cls.aux.name])
def test_every_effect_where_benches_go_different_ways(lanes, entry):
    # far beyond every limit and at rest; effects that take from another axis are in the test of every effect
    def model(k):
        numbers = {
            p.name: SMALL.get(entry.name, 0.02) * 5.0**k if p.size else 3e-5 * 8.0**k for p in entry.parameters()
        }
        return one_axis(((entry.name, {p.name: min(max(numbers[p.name], p.low), p.high) for p in entry.parameters()}),))

    torque = held_torque(N)[:, None] * np.linspace(0.0, 3.0, N)[:, None]
    assert_same([model(k) for k in range(LANES)], [Segment("open", N, np.zeros_like(torque), torque)], lanes)


def test_delays_in_whole_samples_must_be_the_same(lanes):
    torque = held_torque(500)[:, None]
    segment = Segment("late", 500, np.zeros_like(torque), torque)
    alike = [one_axis(frequency_hz=20.0 + k, delay_s=1.22e-3 + 1e-5 * k) for k in range(LANES)]
    assert_same(alike, [segment], lanes)
    lanes.clear()
    # as long in all, on other axes
    content, names = msgspec.to_builtins(AS_BUILT), [port.name for port in AS_BUILT.inputs]
    other = [
        msgspec.convert({**content, "delay_s": {names[k % 2]: 1.22e-3, names[2]: 2e-3}}, type(AS_BUILT))
        for k in range(LANES)
    ]
    segment = closed()
    records = play_side_by_side([SimBench(model, 0) for model in other], segment)
    assert set(lanes) == {1}
    for model, record in zip(other, records, strict=True):
        alone = SimBench(model, 0).play(segment)
        assert isinstance(record, Record)
        np.testing.assert_array_equal(record.channels["theta_x"], alone.channels["theta_x"])


def test_benches_whose_loops_are_not_open_or_closed_alike_are_played_one_by_one(lanes):
    x, z = theta_controller(RATE_HZ), z_controller(RATE_HZ)
    reference = np.full((100, 3), 1e-4)

    def segment(*gates):
        return Segment("s", 100, reference, np.zeros((100, 3)), (x, x, z), gates)

    def played(together):
        benches = [SimBench(AS_BUILT, seed) for seed in range(LANES)]
        benches[0].play(segment(Gate(0, 0, True)))
        for bench in benches[1:]:
            bench.play(segment())
        lanes.clear()
        if together:
            return play_side_by_side(benches, segment(Gate(50, 1, True)))
        return [bench.play(segment(Gate(50, 1, True))) for bench in benches]

    records = played(True)
    assert set(lanes) == {1}
    for found, alone in zip(records, played(False), strict=True):
        np.testing.assert_array_equal(found.channels["theta_x"], alone.channels["theta_x"])


def test_a_bench_that_diverges_takes_no_other_with_it(lanes):
    models = [drawn(AS_BUILT, k) for k in range(LANES)]
    content = msgspec.to_builtins(models[2])
    for mode in content["modes"]:
        mode["decay_rate_1_s"] = -value_of(mode["decay_rate_1_s"]) * 1e3
    models[2] = msgspec.convert(content, type(AS_BUILT))
    records = play_side_by_side([SimBench(model, 1) for model in models], closed())
    assert LANES in lanes and isinstance(records[2], ConfigError) and "not a finite number" in str(records[2])
    with pytest.raises(ConfigError) as alone:
        SimBench(models[2], 1).play(closed())
    assert str(alone.value) == str(records[2])
    for k in (0, 1, 3):
        record = records[k]
        assert isinstance(record, Record)
        np.testing.assert_array_equal(
            record.channels["theta_x"], SimBench(models[k], 1).play(closed()).channels["theta_x"]
        )


def test_the_steps_of_the_bench_as_built_are_all_taken_together():
    steps = {e.name: e.step for e in (*NAMED, *NOISES, *BENCH_ONLY) if e.step is not None}
    # a disturbance whose size is zero is not played
    played = {effect.name for effect in stated(AS_BUILT.effects) if not (effect.sizes() and effect.is_neutral())}
    for name in played & steps.keys():
        assert wide_step(ir.Module(name), name, steps[name], LANES) is not None, name
    # and most of the others
    known = [n for n, step in steps.items() if wide_step(ir.Module(n), n, step, LANES) is not None]
    assert len(known) > 0.6 * len(steps), sorted(set(steps) - set(known))


def test_the_loop_for_several_is_made_aside_once_they_have_been_played_for_long(monkeypatch):
    made: list[Structure] = []
    monkeypatch.setattr(machine, "make_aside", made.append)
    monkeypatch.setattr(machine, "load", lambda structure: structure.lanes == 1)
    monkeypatch.setattr(side_by_side, "LONG_SIDE_BY_SIDE", 10 * N)
    kernel.played.clear()
    benches = [SimBench(drawn(AS_BUILT, k), k) for k in range(LANES)]
    for _ in range(2):
        play_side_by_side(benches, closed())
        assert [s for s in made if s.lanes > 1] == []
    play_side_by_side(benches, closed())
    assert [s.lanes for s in made if s.lanes > 1] == [LANES]
    kernel.played.clear()
