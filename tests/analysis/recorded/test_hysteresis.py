import numpy as np
import pytest

from analysis.measurements.loop_fit import magnetisation
from analysis.recorded.hysteresis import loops_of, steps_of
from analysis.recorded.loop_fit import HELD, loop_fit_of
from sim_backend.errors import DataError

CHANNELS = [("torque_x", "N m", "input", "theta_x"), ("theta_x", "rad", "output", "theta_x")]
PERIOD = 2000


def loops(cycles=2):
    """Slow loops of a spring with iron: the angle is a sine and the torque what it takes."""
    amplitudes = (4.5e-3, 8.5e-3)
    angle = np.concatenate([a * np.sin(2 * np.pi * np.arange(cycles * PERIOD) / PERIOD) for a in amplitudes])
    torque = 11.16 * angle - 0.99 * magnetisation(angle, {**HELD, "pinning": 2.2e-3})
    n = cycles * PERIOD
    return [
        (
            f"loop {i + 1}",
            {"phase": "loop", "axis": "theta_x", "amplitude": 0.05 * (i + 1), "period_samples": PERIOD},
            {"torque_x": torque[i * n : (i + 1) * n], "theta_x": angle[i * n : (i + 1) * n]},
        )
        for i in range(2)
    ]


def test_loops_by_amplitude_without_their_first_cycle(write_log):
    found = loops_of(write_log("hysteresis", CHANNELS, loops()))
    assert list(found) == [0.05, 0.1]
    first = found[0.05]
    assert first.amplitude_rad == pytest.approx(4.5e-3, rel=1e-6)
    # torque is zero where the angle is off by the iron's torque over the spring's: 2.2e-3/3 · 0.99/11.16 · (1 - …)
    assert 0.005 < first.remanence_ratio < 0.02
    assert first.area_j > 0.0  # the mechanism takes energy in


def test_the_fit_finds_the_iron(write_log):
    found = loop_fit_of(write_log("hysteresis", CHANNELS, loops()))
    # the torque is exact and the path averaged over two samples; a shape is searched in steps of 2 %
    assert found.parameters["pinning"] == pytest.approx(2.2e-3, rel=0.01)
    assert found.parameters["size"] == pytest.approx(0.99, rel=0.01)
    assert abs(found.parameters["power_3"]) < 20.0


def test_steps_start_where_the_mechanism_stood(write_log):
    n = 300
    rest = np.full(200, 3.6e-3)
    step = 3.6e-3 + 1e-3 * np.minimum(np.arange(n) / 50.0, 1.0)
    settings = {"axis": "theta_x", "offset_rad": 3.5e-3, "step_rad": 1e-3}
    parts = [
        ("approach 1", {"phase": "approach", **settings}, {"torque_x": np.full(200, 0.04), "theta_x": rest}),
        ("step 1", {"phase": "step", **settings}, {"torque_x": np.full(n, 0.05), "theta_x": step}),
    ]
    (found,) = steps_of(write_log("hysteresis", CHANNELS, parts))
    assert found.start_rad == pytest.approx(3.6e-3)
    assert found.time_s[100] == 0.0  # 10 ms of rest before
    assert found.moved_rad[-1] == pytest.approx(1e-3)
    assert found.command_nm[0] == 0.04


def test_repeated_steps_are_averaged(write_log):
    def part(kind, angle, torque):
        settings = {"phase": kind, "axis": "theta_x", "offset_rad": 0.0, "step_rad": 1e-3}
        return (kind, settings, {"torque_x": np.full(angle.size, torque), "theta_x": angle})

    # the second repeat starts and ends elsewhere
    parts = [
        part("approach", np.full(200, 1e-4), 0.0),
        part("step", np.full(300, 1.2e-3), 0.01),
        part("approach", np.full(200, 3e-4), 0.0),
        part("step", np.full(300, 1.2e-3), 0.01),
    ]
    parts = [(f"{label} {i}", *rest) for i, (label, *rest) in enumerate(parts)]
    (found,) = steps_of(write_log("hysteresis", CHANNELS, parts))
    assert found.repeats == 2 and found.start_rad == pytest.approx(2e-4)
    assert found.moved_rad[-1] == pytest.approx((1.1e-3 + 0.9e-3) / 2)


def test_other_logs_are_refused(write_log):
    run = write_log("chop", CHANNELS, [("chop", {}, {"torque_x": np.zeros(9), "theta_x": np.zeros(9)})])
    for read in (loops_of, steps_of, loop_fit_of):
        with pytest.raises(DataError, match="neither loops nor steps"):
            read(run)
