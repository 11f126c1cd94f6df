"""Motion with open feedback against closed forms, and against the linear bench that is played."""

import msgspec
import numpy as np
import pytest

from analysis.paper.open_loop_motion import FREQUENCY_HZ, SOURCES, motion, open_loop_motion
from sim_backend.bench import Gate, Segment
from sim_backend.control.feedback import theta_controller
from sim_backend.model import load_model
from sim_backend.simbench import SimBench


def test_open_and_closed_motion_are_what_a_bench_shows():
    bench, design = load_model("as-built"), load_model("design")
    noise = [e for e in bench.effects if e.effect == "amplifier-noise"]
    model = msgspec.structs.replace(design, hardware=bench.hardware, effects=noise)
    still, n = np.zeros((1, 3)), 2_000_000
    loops, gates = (theta_controller(), theta_controller(), None), (Gate(0, 0, True), Gate(0, 1, True))
    record = ("theta_x",)
    free = SimBench(model, 8).play(Segment("open", n, still, still, record=record)).channels["theta_x"][20_000:]
    held = SimBench(model, 8).play(Segment("held", n, still, still, feedback=loops, gates=gates, record=record))
    closed = np.std(held.channels["theta_x"][20_000:])
    every, mean = motion(SOURCES["torque noise below 50 Hz, as on the bench"](FREQUENCY_HZ))
    # 200 s of a mode of 4.8 1/s are some thousand independent amplitudes: 2.5 % of standard deviation, four of them
    assert np.std(free) / closed == pytest.approx(every, rel=0.1)
    means = free.reshape(-1, 1000).mean(axis=1)
    # 1,980 means, hardly correlated: 2 %; four of them and the closed one's
    assert np.std(means) / closed == pytest.approx(mean, rel=0.1)


def test_what_the_feedback_does_not_reach_moves_alike_in_both():
    every, mean = motion((FREQUENCY_HZ > 2000.0).astype(float))
    # |1 + L| is within 1 % of one beyond 2 kHz, and a mean of 0.1 s takes nearly all
    assert every == pytest.approx(1.0, abs=0.01) and mean < 0.002


def test_both_readings_of_the_two_microradians_are_told():
    found = open_loop_motion()
    rows = {row[0]: [float(cell) for cell in row[1:]] for row in found.rows}
    assert rows["torque noise below 50 Hz, as on the bench"][1] > 20.0
    assert rows["white torque noise"][2] == pytest.approx(2.0, abs=0.05)
