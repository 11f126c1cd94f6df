"""A controller file comes back as it was written, and one that no strategy could play is refused."""

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
WHOLE = Controller(name="small", sample_rate_hz=10_000.0, model=bench_model(hardware=False), axes=[AXIS])


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
    own = msgspec.structs.replace(WHOLE, to_current=bench.limits.to_current.tolist())
    own.require_bench(bench)
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
