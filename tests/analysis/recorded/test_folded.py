"""Long segments for a fit: means of periods and averaged spectra say what the whole says, and no read is long."""

from __future__ import annotations

import numpy as np
import pytest

import analysis.recorded.folded
import campaigns.facts.finding
import campaigns.facts.missing
from analysis.frequency.frf_records import frequency_response_welch
from analysis.identification.identify import identify_runs
from analysis.linear.simulate import simulate_linear
from analysis.recorded.folded import averaged_response, folded, together, too_long, windowed
from campaigns.log import Run
from sim_backend.errors import DataError
from sim_backend.linear import ModalModel, discretise

RATE_HZ = 10_000.0  # that of the logs in these tests
CHANNELS = [
    ("u1", "N m", "input", "theta_x"),
    ("u2", "N m", "input", "theta_y"),
    ("y1", "rad", "output", "theta_x"),
    ("y2", "rad", "output", "theta_y"),
]
HZ = 2.0 * np.pi
PLANT = ModalModel(
    np.array([300.0 * HZ, 800.0 * HZ]),
    np.array([150.0, 300.0]),
    np.array([[1.0, 0.2], [-0.3, 1.0]]),
    np.zeros((2, 2)),
    np.array([[3e6, 0.0], [1e6, 2e7]]),
    np.zeros((2, 2)),
    np.zeros((2, 2)),
    np.zeros(2),
)


def parts(segments):
    return [(label, given, dict(zip(("u1", "u2", "y1", "y2"), x.T, strict=True))) for label, given, x in segments]


def moved(u, rng, noise):
    y = simulate_linear(discretise(PLANT, RATE_HZ), u)
    return np.concatenate([u, y + noise * y.std(axis=0) * rng.normal(size=y.shape)], axis=1)


@pytest.fixture
def small(monkeypatch):
    """Bounds a hundredth of the real ones, and the longest read in a list of one."""
    monkeypatch.setattr(analysis.recorded.folded, "VALUES_AT_ONCE", 40_000)
    monkeypatch.setattr(analysis.recorded.folded, "BLOCK_VALUES", 8_000)
    monkeypatch.setattr(analysis.recorded.folded, "PIECE", 512)
    monkeypatch.setattr(campaigns.facts.finding, "MOST_NUMBERS", 8_000)
    monkeypatch.setattr(campaigns.facts.missing, "ROWS_AT_ONCE", 655)
    most, read = [0], Run.read

    def watched(run, name, start=0, stop=None):
        most[0] = max(most[0], (run.rows if stop is None else stop) - start)
        return read(run, name, start, stop)

    monkeypatch.setattr(Run, "read", watched)
    return most


def test_means_of_periods_are_those_of_the_whole(write_log, small):
    x = np.random.default_rng(0).normal(size=(107 * 100, 4))
    run = write_log("multisine", CHANNELS, parts([("one", {}, x)]))
    whole = [(run, run.segments[0])]
    # 107 periods of 100 rows of 4 channels are 42,800 numbers, two periods in each mean leave half
    assert too_long(whole) and together(whole, 100, 107) == 2
    found = folded(run, run.segments[0], "output", 100, 107, 2)
    expected = x[100:, 2:].reshape(53, 2, 100, 2).mean(axis=1)
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-15)
    assert small[0] <= 8_000 // 2
    np.testing.assert_array_equal(folded(run, run.segments[0], "input", 100, 107, 1), x[:, :2].reshape(107, 100, 2))


def test_two_means_are_left_however_long_a_period_is(write_log, small):
    run = write_log("multisine", CHANNELS, parts([("one", {}, np.zeros((90_000, 4)))]))
    assert together([(run, run.segments[0])], 30_000, 3) == 1
    assert together([(run, run.segments[0])], 15_000, 6) == 3


def test_an_averaged_response_in_blocks_is_that_of_the_whole(write_log, small):
    rng = np.random.default_rng(1)
    x = moved(rng.normal(size=(12_000, 2)), rng, 0.01)
    run = write_log("free", CHANNELS, parts([("one", {}, x)]))
    found, u, y = averaged_response([(run, run.segments[0])])
    whole = frequency_response_welch(x[:, :2], x[:, 2:], RATE_HZ, 512)
    np.testing.assert_array_equal(found.frequency_hz, whole.frequency_hz)
    # the offset is another one: a constant leaks by rounding alone
    np.testing.assert_allclose(found.response, whole.response, rtol=1e-9, atol=1e-12 * np.abs(whole.response).max())
    np.testing.assert_allclose(found.variance, whole.variance, rtol=1e-6)
    np.testing.assert_allclose(np.concatenate([u, y])[:, 0], x.mean(axis=0), atol=1e-15)
    assert small[0] <= 8_000 // 4 + 1


def test_an_input_that_is_another_ones_copy_is_refused(write_log, small):
    rng = np.random.default_rng(2)
    one = rng.normal(size=(12_000, 1))
    run = write_log("free", CHANNELS, parts([("one", {}, moved(np.repeat(one, 2, axis=1), rng, 0.0))]))
    with pytest.raises(DataError, match="do not move independently at .* Hz: .* the limit is 1e[+]08"):
        averaged_response([(run, run.segments[0])])
    with pytest.raises(DataError, match="record longer"):
        averaged_response([(run, type(run.segments[0])("short", 0, 600, {}))])


def test_of_a_segment_too_long_the_middle_is_taken(write_log, small):
    run = write_log("free", CHANNELS, parts([("long", {}, np.zeros((30_000, 4))), ("short", {}, np.zeros((100, 4)))]))
    cut = [(s.label, s.start, s.stop) for _, s in windowed([(run, s) for s in run.segments])]
    assert cut == [("long", 10_000, 20_000), ("short", 30_000, 30_100)]


def check(found):
    """The plant's modes, within four of the standard deviations that the fit states and the bias of the window.

    A Hann window smears over about a line to either side, which widens a mode by the square of a line over its half
    width: (2.4 / 24)², 1 % of its decay rate.
    """
    for k, mode in enumerate(found.modes):
        exact_hz, exact_1_s = PLANT.omega_rad_s[k] / HZ, PLANT.sigma_1_s[k]
        assert abs(mode["frequency_hz"] - exact_hz) < 4.0 * mode["frequency_std_hz"] + 1e-3 * exact_hz
        assert abs(mode["decay_rate_1_s"] - exact_1_s) < 4.0 * mode["decay_rate_std_1_s"] + 0.01 * exact_1_s


def test_a_long_free_record_is_identified_from_averaged_spectra(write_log, small, monkeypatch):
    monkeypatch.setattr(analysis.recorded.folded, "PIECE", 4096)  # lines 2.4 Hz apart, the narrower mode 24 Hz wide
    rng = np.random.default_rng(3)
    run = write_log("free", CHANNELS, parts([("one", {}, moved(rng.normal(size=(40_000, 2)), rng, 0.01))]))
    found = identify_runs([run], modes=2)
    assert found.method == "free, averaged spectra"
    check(found)
    assert small[0] <= 8_000 // 2 + 1


def test_a_long_periodic_record_is_identified_from_means_of_its_periods(write_log, small):
    rng, period, periods = np.random.default_rng(4), 500, 40
    segments = []
    for k in range(2):
        wave = rng.normal(size=(period, 2))
        x = moved(np.tile(wave, (periods + 5, 1)), rng, 0.02)[5 * period :]  # the transient has died away
        segments.append((f"realisation {k}", {"period_samples": period}, x))
    run = write_log("multisine", CHANNELS, parts(segments))
    assert together([(run, s) for s in run.segments], period, periods) == 4
    found = identify_runs([run], modes=2)
    assert found.method == "periodic, zero-order hold"
    check(found)
    # noise of 2 % of the output's rms in every period, whatever is averaged; its estimate from 9 of 10 means of
    # 250 lines of 2 realisations and 2 outputs, 9,000 numbers, scatters by 1 %
    assert found.noise == pytest.approx(0.02, rel=0.05)
    assert small[0] <= 8_000 // 2


def test_segments_without_rows_are_nothing_to_fit(write_log):
    run = write_log("free", CHANNELS, parts([("one", {}, np.zeros((0, 4)))]))
    with pytest.raises(DataError, match="no segment remains to fit"):
        identify_runs([run])
