"""Long records are measured in parts: nothing larger is ever read at once, and the numbers are those of the whole."""

from __future__ import annotations

import numpy as np
import pytest

import analysis.recorded.chop
import analysis.recorded.sweep
from analysis.measurements.chop import chop_stability
from analysis.measurements.thermal import drift
from analysis.recorded.chop import chop_phase
from analysis.recorded.drift import drift_of
from analysis.recorded.sweep import sweep_of
from campaigns.log import Run

DWELL, WINDOW, CYCLES = 100, 40, 50
OUTPUTS = [("theta_x", "rad", "output", "theta_x"), ("theta_y", "rad", "output", "theta_y")]
SWEPT = [("torque_x", "N m", "input", "theta_x"), ("theta_x", "rad", "output", "theta_x")]


@pytest.fixture
def most_rows(monkeypatch):
    """The longest stretch of rows that is read at once, in a list of one."""
    most, read = [0], Run.read

    def watched(run, name, start=0, stop=None):
        most[0] = max(most[0], (run.rows if stop is None else stop) - start)
        return read(run, name, start, stop)

    monkeypatch.setattr(Run, "read", watched)
    return most


@pytest.fixture
def chop(write_log):
    """A chop of both axes with noise and drift, in segments of ten periods."""
    rng = np.random.default_rng(2)
    level = np.tile(np.repeat([8.5e-3, 0.0], DWELL), CYCLES)
    noise = 1e-6 * rng.normal(size=(level.size, 2)).cumsum(axis=0) / 50 + 1e-6 * rng.normal(size=(level.size, 2))
    angles = np.stack([level, np.zeros_like(level)], axis=1) + noise
    given = {"phase": "chop", "alpha_deg": 0.0, "from_rad": 0.0, "to_rad": 8.5e-3}
    given |= {"dwell_samples": DWELL, "window_samples": WINDOW, "position_2_at": 0}
    step = 10 * 2 * DWELL
    parts = [
        (f"chop {k}", given, {"theta_x": a[:, 0], "theta_y": a[:, 1]})
        for k, a in enumerate(angles.reshape(-1, step, 2))
    ]
    return write_log("thermal", OUTPUTS, parts), angles.reshape(CYCLES, 2 * DWELL, 2)


def test_a_chop_in_parts_gives_the_numbers_of_the_whole(chop, most_rows, monkeypatch):
    run, cycles = chop
    monkeypatch.setattr(analysis.recorded.chop, "VALUES_AT_ONCE", 7 * 2 * 2 * DWELL)  # 7 periods, 8 parts
    phase = chop_phase(run)
    windows = np.stack([cycles[:, 2 * DWELL - WINDOW :], cycles[:, DWELL - WINDOW : DWELL]])
    whole = chop_stability(windows, phase.commanded_rad)
    found = phase.stability()
    for name in whole.__dataclass_fields__:
        # the mean of 4,000 numbers of 8.5e-3 is rounded by up to 4,000 · 1.1e-16 of them: 4e-15, in 1e-6 of scatter
        np.testing.assert_allclose(getattr(found, name), getattr(whole, name), rtol=1e-8, atol=4e-15)
    assert found.stability_rad > 1e-6
    np.testing.assert_array_equal(phase.window_means("theta_x", "theta_y"), windows.mean(axis=2))
    np.testing.assert_array_equal(phase.moves(2, "theta_x", skip=9), cycles[9:, :DWELL, 0].mean(axis=0))
    assert most_rows[0] <= 4 * 7 * DWELL  # `moves` reads one channel, so twice as many periods
    assert run.rows > 3 * most_rows[0]


def test_power_and_parasitic_motion_in_parts_are_those_of_the_whole(write_log, most_rows, monkeypatch):
    rng, rows = np.random.default_rng(4), CYCLES * 2 * DWELL
    values = {"theta_x": np.zeros(rows), "theta_y": np.zeros(rows), "z": 1e-6 * rng.normal(size=rows)}
    values |= {f"current_{a}": rng.normal(size=rows) * (a + 1) for a in range(3)}
    channels = [*OUTPUTS, ("z", "m", "output", "z"), *((f"current_{a}", "A", "aux", f"a{a}") for a in range(3))]
    given = {"phase": "chop", "alpha_deg": 0.0, "from_rad": 0.0, "to_rad": 8.5e-3}
    given |= {"dwell_samples": DWELL, "window_samples": WINDOW}
    monkeypatch.setattr(analysis.recorded.chop, "VALUES_AT_ONCE", 7 * 2 * DWELL)
    phase = chop_phase(write_log("settling", channels, [("chop", given, values)]))
    found = phase.power(5.7, 7.9)
    currents = np.stack([values[f"current_{a}"] for a in range(3)])
    # the sum of 10,000 squares, rounded at every addition
    np.testing.assert_allclose(found.actuator_w, np.mean((5.7 / 7.9 * currents) ** 2, axis=1), rtol=1e-12)
    assert found.total_w == pytest.approx(found.actuator_w.sum(), rel=1e-15)
    assert found.peak_a == np.abs(currents).max()
    assert phase.largest("z") == np.abs(values["z"]).max()
    assert most_rows[0] == 7 * 2 * DWELL


def test_the_drift_of_a_long_chop_reads_a_part_at_a_time(chop, most_rows, monkeypatch):
    run, cycles = chop
    monkeypatch.setattr(analysis.recorded.chop, "VALUES_AT_ONCE", 1)  # at least a period
    found = drift_of(run)
    means = cycles[:, 2 * DWELL - WINDOW :].mean(axis=1)
    expected = drift(found.time_s[0], means)
    np.testing.assert_allclose(found.drift[0].total_rad, expected.total_rad, rtol=1e-9)
    assert most_rows[0] == 2 * DWELL


def test_a_sweep_in_parts_gives_the_numbers_of_the_whole_and_is_measured_once(write_log, most_rows, monkeypatch):
    rng, rows = np.random.default_rng(3), 3000
    parts = []
    for f in (11.0, 17.3, 23.9, 31.7, 41.1):
        phase = 2.0 * np.pi * f * np.arange(rows) / 1e4
        values = {"torque_x": 2e-3 * np.cos(phase), "theta_x": np.sin(phase) + 0.01 * rng.normal(size=rows)}
        parts.append((f"{f} Hz", {"axis": "theta_x", "frequency_hz": f, "measure_from": 500}, values))
    whole = sweep_of(write_log("sinesweep", SWEPT, parts))
    assert most_rows[0] == 5 * rows
    most_rows[0] = 0
    monkeypatch.setattr(analysis.recorded.sweep, "ROWS_AT_ONCE", 2 * rows)
    run = write_log("sinesweep", SWEPT, parts, name="again.h5")
    found = sweep_of(run)
    assert most_rows[0] == 2 * rows
    for name in ("frequency_hz", "response", "variance", "amplitude"):
        # phases that count from another sample are rounded otherwise: some 1e-16 of a few hundred turns
        np.testing.assert_allclose(getattr(found, name), getattr(whole, name), rtol=1e-12)
    assert sweep_of(run) is found
