import numpy as np
import pytest

from analysis.recorded.chop import chop_phase
from analysis.recorded.drift import drift_of
from sim_backend.errors import DataError

CHANNELS = [
    ("theta_x", "rad", "output", "theta_x"),
    ("theta_y", "rad", "output", "theta_y"),
    ("z", "m", "output", "z"),
    ("current_a1", "A", "aux", "a1"),
]
DWELL, WINDOW = 100, 40


def settings(phase="chop", **more):
    return {
        "phase": phase,
        "alpha_deg": 90.0,
        "from_rad": -1e-3,
        "to_rad": 8.5e-3,
        "dwell_samples": DWELL,
        "window_samples": WINDOW,
        "position_2_at": 0,
        **more,
    }


def period(settle=30):
    """Position 2 first: a step that lies 5 µrad off for `settle` samples, then exact; the same back to position 1."""
    y = np.repeat([8.5e-3, -1e-3], DWELL)
    for start, before in ((0, -1e-3), (DWELL, 8.5e-3)):
        y[start : start + settle + 1] += 5e-6
        y[start] = before
    return y


def values(y):
    n = y.size
    return {"theta_x": np.zeros(n), "theta_y": y, "z": np.full(n, -2e-6), "current_a1": np.full(n, 0.5)}


def test_windows_settling_and_power_of_a_chop_with_known_contents(write_log):
    y = np.tile(period(), 4)
    parts = [("approach", settings("approach"), values(np.zeros(DWELL)))]
    parts += [(f"chop {i}", settings(), values(half)) for i, half in enumerate((y[:400], y[400:]))]
    phase = chop_phase(write_log("chop", CHANNELS, parts))
    assert (phase.start, phase.stop, phase.start_s) == (DWELL, DWELL + 800, 0.01)
    np.testing.assert_allclose(phase.commanded_rad, [[0.0, -1e-3], [0.0, 8.5e-3]], atol=1e-18)
    windows = phase.windows("theta_y")
    assert windows.shape == (2, 4, WINDOW, 1)
    np.testing.assert_allclose(windows[0], -1e-3)
    np.testing.assert_allclose(windows[1], 8.5e-3)
    found = phase.settling("theta_y")
    np.testing.assert_allclose(found.time_s, 30 / 10_000.0)
    # up to position 2 the error is beyond it, down to position 1 it is short of it
    np.testing.assert_allclose(found.overshoot, [0.0, 5e-6], atol=1e-15)
    power = phase.power(5.7, 7.9)
    assert power.total_w == pytest.approx((0.5 * 5.7 / 7.9) ** 2)
    assert phase.stability().inside_percent.tolist() == [100.0, 100.0]


def test_a_phase_that_begins_within_a_period_is_cut_where_its_first_move_is(write_log):
    y = np.roll(np.tile(period(), 3), 70)  # the first move to position 2 comes after 70 samples
    run = write_log("settling", CHANNELS, [("chop", settings(position_2_at=70), values(y))])
    phase = chop_phase(run)
    assert phase.cycles("theta_y").shape == (2, 2 * DWELL)
    np.testing.assert_allclose(phase.cycles("theta_y")[0], period())


def test_drift_of_a_long_chop(write_log):
    cycles = 200
    y = np.tile(period(), cycles)
    t = np.arange(y.size) / 10_000.0
    moved = y + 1e-6 * t / t[-1]
    found = drift_of(write_log("thermal", CHANNELS, [("chop", settings(), values(moved))]))
    assert found.mean_rad.shape == (2, cycles, 2)
    # from the middle of the first window to that of the last: all but one period of the whole
    for one in found.drift:
        assert one.total_rad[1] == pytest.approx(1e-6 * (cycles - 1) / cycles, rel=1e-3)
        assert not one.significant[0]
    np.testing.assert_allclose(np.diff(found.time_s, axis=1), 2 * DWELL / 10_000.0)
    assert found.time_s[0, 0] - found.time_s[1, 0] == pytest.approx(DWELL / 10_000.0)
    assert found.warming_k is None


def test_logs_without_what_is_asked_for_are_refused(write_log):
    run = write_log("sinesweep", CHANNELS, [("5 Hz", {"frequency_hz": 5.0}, values(np.zeros(50)))])
    with pytest.raises(DataError, match="no phase 'chop'"):
        chop_phase(run)
    broken = settings()
    del broken["window_samples"]
    other = write_log("chop", CHANNELS, [("chop", broken, values(period()))], name="other.h5")
    with pytest.raises(DataError, match="no setting 'window_samples'"):
        chop_phase(other)
    bare = write_log("chop", CHANNELS[:3], [("chop", settings(), _without(period()))], name="bare.h5")
    with pytest.raises(DataError, match="holds no currents"):
        chop_phase(bare).power(5.7, 7.9)


def _without(y):
    return {k: v for k, v in values(y).items() if k != "current_a1"}
