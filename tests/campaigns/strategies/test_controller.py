"""A controller file comes back as it was written, and one that no strategy could play is refused."""

import math

import msgspec
import numpy as np
import pytest

from campaigns.benches import BENCHES
from campaigns.strategies.controller import (
    AxisControl,
    Blocks,
    Controller,
    DesignedFor,
    dump_controller,
    load_controller,
    parse_controller,
)
from sim_backend.bench import SIMULATED
from sim_backend.control.feedback import theta_controller
from sim_backend.errors import ConfigError
from sim_backend.simbench import SimBench
from tests.small_bench import bench_model

AXIS = AxisControl(
    dof="theta_y",
    reach_rad=8.5e-3,
    move_samples=47,
    concentration=3.0,
    feedback=Blocks.of(theta_controller()),
    learning=Blocks(a=[], b=[], c=[], d=2.0),
    lead_samples=10,
    q_cutoff_hz=700.0,
    q_half_length=60,
    wait_s=0.4,
    gains=[1.0, 0.5],
)
COILS = SimBench(bench_model(), 0).limits.to_current.tolist()
WHOLE = Controller(
    name="small", sample_rate_hz=10_000.0, model=bench_model(hardware=False), axes=[AXIS], to_current=COILS
)
ONE = {"a": [[[0.5, 0.0], [0.0, 0.0]]], "b": [[1.0, 0.0]], "c": [[1.0, 0.0]], "d": 0.0}
"""One sound block."""


def blocks(**changes):
    return Blocks(**{**ONE, **changes})


def test_it_comes_back_as_it_was_written(tmp_path):
    path = tmp_path / "controller.toml"
    path.write_text(dump_controller(WHOLE), encoding="utf-8")
    assert load_controller(path) == WHOLE
    f = np.array([1.0, 30.0, 500.0])
    back = load_controller(path).axes[0].feedback.filter(10_000.0)
    np.testing.assert_array_equal(back.frequency_response(f), theta_controller().frequency_response(f))
    assert back.integrator == theta_controller().integrator


def test_longer_moves_take_longer_by_the_root_of_their_length():
    assert [AXIS.samples(x * 8.5e-3) for x in (0.1, -1.0, 4.0, 1.21)] == [47, 47, 94, 52]


def test_a_move_that_would_take_for_ever_is_refused():
    short = msgspec.structs.replace(AXIS, reach_rad=5e-324)
    with pytest.raises(ConfigError, match="axis 'theta_y': a move of 0.0085 rad takes inf samples"):
        short.samples(8.5e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gains": [1.0, 1.5]}, "learning gains"),
        ({"gains": [float("nan")]}, "learning gains"),
        ({"gains": []}, "give one or more"),
        ({"shrinks_to": 1.0}, "shrinks_to is 1"),
        (
            {"learning": Blocks(a=[[[1.05, 0.0], [0.0, 0.0]]], b=[[1.0, 0.0]], c=[[1.0, 0.0]], d=0.0)},
            "is 1.05 from zero",
        ),
        ({"wait_s": 1e9}, "beyond 600 s"),
        ({"wait_s": -0.1}, "neither may be negative"),
        ({"lead_samples": -1}, "neither may be negative"),
        ({"reach_rad": 0.0}, "reach_rad"),
        ({"move_samples": 30_000_000}, "move of 30000000 samples"),
        ({"q_half_length": 60_000_000}, "60000000 taps aside"),
        ({"concentration": 40.0}, "concentration"),
        ({"q_cutoff_hz": 6000.0}, "Q filter"),
        (
            {"feedback": Blocks(a=[[[0.5, 0.0], [0.0, 0.0]]], b=[[1.0, 0.0], [1.0, 0.0]], c=[[1.0, 0.0]], d=0.0)},
            "shape",
        ),
        ({"feedback": Blocks(a=[[[0.5], [0.0, 0.0]]], b=[], c=[], d=0.0)}, "different lengths"),
        # there is no improper filter in blocks; one without some of its parts is no filter
        *(({part: blocks(**{name: []})}, "shape") for part in ("feedback", "learning") for name in ("a", "b", "c")),
        *(
            ({part: blocks(**change)}, "(not|must be) finite")
            for part in ("feedback", "learning")
            for bad in (math.nan, math.inf, -math.inf)
            for change in (
                {"a": [[[bad, 0.0], [0.0, 0.0]]]},
                {"b": [[bad, 0.0]]},
                {"c": [[1.0, bad]]},
                {"d": bad},
            )
        ),
        ({"feedback": blocks(a=[[[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]]])}, "a has shape"),
        ({"feedback": blocks(b=[[1.0]])}, "b has shape"),
        ({"learning": blocks(c=[[1.0, 0.0], [1.0, 0.0]])}, "c has shape"),
        ({"feedback": blocks(integrator=0)}, "block 0 of 1 is not an integrator"),
        ({"feedback": blocks(integrator=7)}, "block 7 of 1 is not an integrator"),
        ({"feedback": blocks(integrator=-1)}, "block -1 of 1 is not an integrator"),
        *(
            ({name: bad}, message)
            for bad in (math.nan, math.inf)
            for name, message in (
                ("reach_rad", "reach_rad"),
                ("concentration", "concentration"),
                ("q_cutoff_hz", "Q filter"),
                ("wait_s", "neither may be negative"),
                ("shrinks_to", "shrinks_to"),
            )
        ),
        ({"gains": [math.inf]}, "learning gains"),
        ({"move_samples": 0}, "move"),
        ({"q_half_length": -1}, "Q filter"),
    ],
)
def test_what_cannot_be_played_is_refused(change, message):
    broken = msgspec.structs.replace(WHOLE, axes=[msgspec.structs.replace(AXIS, **change)])
    with pytest.raises(ConfigError, match=f"x.toml, axis 'theta_y'.*{message}"):
        parse_controller(dump_controller(broken), "x.toml")


@pytest.mark.parametrize("text", ["schema = ", 'schema = "mccd-controller/9"', "speed = 3"])
def test_what_is_no_controller_is_refused(text):
    with pytest.raises(ConfigError, match="x.toml: .*mccd design"):
        parse_controller(text, "x.toml")


@pytest.mark.parametrize("number", ["1e999", "[[1, 2]]", '"0.5"', "true", "{ value = 0.5 }"])
def test_a_gain_that_is_no_number_is_refused(number):
    text = dump_controller(msgspec.structs.replace(WHOLE, axes=[msgspec.structs.replace(AXIS, reach_rad=0.25)]))
    with pytest.raises(ConfigError, match=r"x\.toml"):
        parse_controller(text.replace("reach_rad = 0.25", f"reach_rad = {number}"), "x.toml")


def test_a_filter_without_blocks_is_a_gain():
    gain = msgspec.structs.replace(AXIS, feedback=Blocks(a=[], b=[], c=[], d=0.25))
    back = parse_controller(dump_controller(msgspec.structs.replace(WHOLE, axes=[gain])), "x.toml")
    played = back.axes[0].feedback.filter(10_000.0)
    np.testing.assert_array_equal(played.frequency_response([0.0, 100.0, 4999.0]), 0.25)


@pytest.mark.parametrize(
    ("coils", "said"),
    [
        ([], "0 rows of no numbers"),
        ([[]], r"1 rows of \[0\] numbers"),
        ([[1.0, 2.0], [1.0]], r"2 rows of \[1, 2\] numbers"),
        ([[1.0, math.nan]], "not finite"),
        ([[1.0, -math.inf]], "not finite"),
    ],
)
def test_coils_that_tell_no_bench_are_refused(coils, said):
    text = dump_controller(msgspec.structs.replace(WHOLE, to_current=coils))
    with pytest.raises(ConfigError, match=f"x.toml: to_current has .*{said}.*write it with `mccd design`"):
        parse_controller(text, "x.toml")


def test_a_file_must_say_for_which_coils_it_is():
    lines = dump_controller(WHOLE).splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("to_current"))
    stop = next(i for i in range(start, len(lines)) if lines[i].strip() == "]") if lines[start].endswith("[") else start
    with pytest.raises(ConfigError, match="x.toml: .*to_current.*mccd design"):
        parse_controller("\n".join(lines[:start] + lines[stop + 1 :]), "x.toml")


def test_an_axis_that_the_model_does_not_move_is_refused():
    stray = msgspec.structs.replace(WHOLE, axes=[AXIS, msgspec.structs.replace(AXIS, dof="phi")])
    with pytest.raises(ConfigError, match="x.toml, axis 'phi': its model moves .*theta_y.*whether this loop is stable"):
        parse_controller(dump_controller(stray), "x.toml")


def test_an_axis_twice_or_none_is_refused():
    for axes in ([], [AXIS, AXIS]):
        with pytest.raises(ConfigError, match="each once"):
            parse_controller(dump_controller(msgspec.structs.replace(WHOLE, axes=axes)), "x.toml")


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ConfigError, match="no such file; write one with `mccd design`"):
        load_controller(tmp_path / "none.toml")
    (tmp_path / "latin.toml").write_bytes(b'name = "\xe9"')
    with pytest.raises(ConfigError, match="not UTF-8"):
        load_controller(tmp_path / "latin.toml")


def test_a_controller_whose_model_has_another_rate_is_refused():
    slow = msgspec.structs.replace(WHOLE.model, sample_rate_hz=5000.0)
    with pytest.raises(ConfigError, match="its model for 5000 Hz"):
        parse_controller(dump_controller(msgspec.structs.replace(WHOLE, model=slow)), "x.toml")


def test_a_bench_of_other_units_or_coils_is_foreign():
    bench = SimBench(bench_model(), 0)
    WHOLE.require_bench(bench)
    # within a tenth it is the same bench; a bench without coils has a coil of its own for every axis
    msgspec.structs.replace(WHOLE, to_current=(1.05 * bench.limits.to_current).tolist()).require_bench(bench)
    with pytest.raises(ConfigError, match="design one for this bench"):
        WHOLE.require_bench(SimBench(bench_model(hardware=False), 0))
    outputs = [msgspec.structs.replace(p, unit="mrad" if p.unit == "rad" else p.unit) for p in WHOLE.model.outputs]
    in_mrad = msgspec.structs.replace(WHOLE, model=msgspec.structs.replace(WHOLE.model, outputs=outputs))
    with pytest.raises(ConfigError, match="theta_x in mrad, the bench's is in rad.*another bench"):
        in_mrad.require_bench(bench)
    for coils in ((2.0 * bench.limits.to_current).tolist(), bench.limits.to_current[:2].tolist()):
        with pytest.raises(ConfigError, match="coils with up to .* design one for this bench"):
            msgspec.structs.replace(WHOLE, to_current=coils).require_bench(bench)


@pytest.mark.parametrize(
    ("identity", "expected"),
    [
        ({"kind": "sim", "name": "as-built", "serial": "seed-3", "version": "1"}, DesignedFor(name="as-built")),
        ({"kind": "emulator", "name": "as-built", "serial": "seed-4", "version": "1"}, DesignedFor(name="as-built")),
        ({"kind": "serial", "name": "chopper", "serial": "A7"}, DesignedFor(name="chopper", serial="A7")),
        ({"kind": "tcp", "name": "chopper", "serial": "A7"}, DesignedFor(name="chopper", serial="A7")),
        ({"kind": "sim", "name": "simulated", "serial": "seed-0"}, None),  # within something else
        ({}, None),  # an imported log
    ],
)
def test_a_bench_is_known_by_its_name_and_unless_it_is_simulated_by_its_serial_number(identity, expected):
    assert DesignedFor.of(identity) == expected


def test_the_kinds_that_are_simulated_are_those_that_repeat_their_records():
    assert set(SIMULATED) == {name for name, kind in BENCHES.items() if kind.repeatable}


def test_another_bench_by_name_or_serial_number_is_foreign():
    here = SimBench(bench_model(), 7, name="here")
    for own in (None, DesignedFor(name="here")):
        msgspec.structs.replace(WHOLE, bench=own).require_bench(here)
    for other in (DesignedFor(name="there"), DesignedFor(name="here", serial="A7")):
        made = parse_controller(dump_controller(msgspec.structs.replace(WHOLE, bench=other)), "x.toml")
        with pytest.raises(ConfigError, match=rf"designed for the bench '{other.name}'.*this is 'here'.*\[bench\]"):
            made.require_bench(here)
        made.require_bench(SimBench(bench_model(), 7))
