import numpy as np
import pytest
from scipy import signal
from scipy.optimize import curve_fit
from scipy.stats import binom

from analysis.measurements.sinefit import fit_sines, sine_response
from sim_backend.errors import ConfigError, DataError

RATE = 10000.0


def _record(rng, frequency, length, gap, phasors, noise):
    stop = np.cumsum(length + gap)
    start = stop - length
    t = np.arange(stop[-1]) / RATE
    record = noise(stop[-1])
    for s, e, f, p in zip(start, stop, frequency, phasors, strict=True):
        record[s:e] += (p * np.exp(2j * np.pi * f * t[s:e])[:, None]).real + 4.0
    return record, start, stop


def test_matches_an_independent_least_squares_fit(rng):
    f, length = np.array([5.03, 700.0]), np.array([5000, 1234])
    record, start, stop = _record(rng, f, length, 50, [0.3 + 0.7j, 2.0 - 1.0j], lambda n: rng.normal(size=(n, 1)))
    got = fit_sines(record, RATE, start, stop, f, noise_lines=0)
    for k in range(2):
        t = np.arange(start[k], stop[k]) / RATE

        def sine(t, a, b, offset, f=f[k]):
            return a * np.cos(2 * np.pi * f * t) - b * np.sin(2 * np.pi * f * t) + offset

        want, covariance = curve_fit(sine, t, record[start[k] : stop[k], 0], p0=[1.0, 1.0, 0.0])
        found = [got.phasor[k, 0].real, got.phasor[k, 0].imag, got.offset[k, 0]]
        # curve_fit differentiates numerically, to about 1e-7 of the standard deviation
        assert np.allclose(found, want, atol=1e-5 * np.sqrt(covariance[0, 0]))
        assert np.trace(got.covariance[k, 0]) == pytest.approx(np.trace(covariance), rel=1e-5)


def test_two_sigma_holds_in_coloured_noise(rng):
    f = np.array([70.0, 700.0, 1234.5, 4000.0])
    length, inside, trials = np.array([3000, 1500, 1111, 2000]), 0, 200

    def noise(n):
        return signal.lfilter([1.0], [1.0, -0.9], 0.05 * rng.normal(size=(n, 1)), axis=0)

    for _ in range(trials):
        record, start, stop = _record(rng, f, length, 10, [0.3 + 0.7j] * 4, noise)
        got = fit_sines(record, RATE, start, stop, f)
        error = np.abs(got.amplitude[:, 0] - np.abs(0.3 + 0.7j))
        inside += int(np.sum(error < 2.0 * np.sqrt(0.5 * got.variance[:, 0])))
    # noise from 16 real degrees of freedom: two sigma of a Student t(16) hold 93.7 %
    low, high = binom.ppf([1e-4, 1.0 - 1e-4], 4 * trials, 0.937)
    assert low <= inside <= high


def test_response_of_two_inputs_and_its_uncertainty(rng):
    gain = np.array([[2.0 + 1.0j, -0.5j], [0.3, 1.5 - 0.2j]])
    f, length = np.repeat([60.0, 600.0], 2), np.full(4, 1500)
    drive = np.tile(np.array([[1.0, 0.1j], [0.2, 1.0]]), (2, 1))
    ratio = []
    for _ in range(100):
        u, start, stop = _record(rng, f, length, 0, drive, lambda n: 0.02 * rng.normal(size=(n, 2)))
        y, _, _ = _record(rng, f, length, 0, drive @ gain.T, lambda n: 0.05 * rng.normal(size=(n, 2)))
        got = sine_response(*(fit_sines(x, RATE, start, stop, f) for x in (u, y)))
        ratio.append(np.abs(got.response - gain) ** 2 / got.variance)
    assert got.response.shape == (2, 2, 2)
    # mean of 800 ratios of about F(2, 16 and more): between 1 and 8/7, standard deviation about 1.3; five of them
    assert 1.0 - 5.0 * 1.3 / np.sqrt(800.0) < np.mean(ratio) < 8.0 / 7.0 + 5.0 * 1.3 / np.sqrt(800.0)
    assert np.allclose(got.phase_std_rad, got.magnitude_std / np.abs(got.response))


def test_bad_segments_are_refused(rng):
    x = rng.normal(size=(1000, 1))
    with pytest.raises(ConfigError, match="overlap"):
        fit_sines(x, RATE, np.array([0, 100]), np.array([200, 300]), np.array([100.0, 200.0]))
    with pytest.raises(ConfigError, match="between 0 and half"):
        fit_sines(x, RATE, np.array([0]), np.array([500]), np.array([6000.0]))
    with pytest.raises(DataError, match="one period"):
        fit_sines(x, RATE, np.array([0]), np.array([500]), np.array([5.0]))
    fit = fit_sines(np.tile(x, (1, 2)), RATE, np.array([0, 500]), np.array([500, 1000]), np.array([100.0, 100.0]))
    with pytest.raises(DataError, match="do not drive the 2 inputs"):
        sine_response(fit, fit)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_a_reading_that_is_none_is_told_with_its_place(rng, value):
    record = rng.standard_normal((3000, 2))
    record[2100, 1] = value
    ends = np.array([1000, 2000, 3000])
    with pytest.raises(DataError, match="segment 2 at 30.0 Hz: sample 100 of channel 1 is"):
        fit_sines(record, 1000.0, ends - 1000, ends, np.array([10.0, 20.0, 30.0]))
    # outside of the segments it does no harm
    assert fit_sines(record, 1000.0, ends[:2] - 1000, ends[:2], np.array([10.0, 20.0])).amplitude.shape == (2, 2)
