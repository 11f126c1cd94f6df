"""Broadband vibration: a hump of the form of a torque through the plant, found, measured, and not invented."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.diagnosis.records.dataset import Window
from analysis.diagnosis.variance.broadband import broadband
from analysis.diagnosis.variance.torques import resonator
from sim_backend.effects.broadband_vibration import BroadbandVibration
from tests.analysis.diagnosis.residuals import RATE_HZ, moved, setting_of

N = 24_000


def _noise(rng: np.random.Generator) -> np.ndarray:
    """White noise with a slow part, as of a drift."""
    slow = lfilter([1.0], [1.0, -0.98], rng.standard_normal(N + 500))[500:]
    return np.asarray(0.01 * (rng.standard_normal(N) + 0.1 * slow))


def _band(rng: np.random.Generator, centre_hz: float, width_hz: float) -> np.ndarray:
    """White noise through two poles of half the width, of unit variance."""
    radius, angle = math.exp(-math.pi * width_hz / RATE_HZ), 2.0 * math.pi * centre_hz / RATE_HZ
    lead = int(10.0 * RATE_HZ / width_hz)
    x = lfilter([1.0], [1.0, -2.0 * radius * math.cos(angle), radius**2], rng.standard_normal(N + lead))[lead:]
    a1, a2 = -2.0 * radius * math.cos(angle), radius**2
    return np.asarray(x * math.sqrt((1.0 - a2) * ((1.0 + a2) ** 2 - a1**2) / (1.0 + a2)))


def _case(seed: int, rms: float, centre_hz: float, width_hz: float):
    rng = np.random.default_rng(seed)
    force = np.repeat(rng.uniform(-1.0, 1.0, N // 400), 400)
    shake = rms * _band(rng, centre_hz, width_hz)
    residual = _noise(rng) + moved(shake)
    return setting_of(force, moved(force) + residual, residual, 0.01)


@pytest.mark.parametrize(("rms", "centre_hz", "width_hz"), [(0.01, 30.0, 6.0), (0.01, 12.0, 4.0), (0.1, 60.0, 15.0)])
def test_a_band_is_found_and_measured(rms: float, centre_hz: float, width_hz: float) -> None:
    """Each of its numbers, over four records, is right to three standard deviations of their mean."""
    off = []
    for seed in range(4):
        (cause,) = broadband(*_case(seed, rms, centre_hz, width_hz))
        assert cause.p_value < 1e-6
        truth = {"rms": rms, "centre_hz": centre_hz, "bandwidth_hz": width_hz}
        off.append([(getattr(cause.effect, k) - v) / cause.std[k] for k, v in truth.items()])
    # half a standard deviation more for what a digital resonator differs from a continuous one
    assert np.max(np.abs(np.mean(off, axis=0))) < 3.0 / math.sqrt(len(off)) + 0.5


@pytest.mark.parametrize(("rms", "found"), [(0.0, 1), (0.01, 0)])
def test_a_model_that_states_a_vibration_of_zero_hides_none(rms: float, found: int) -> None:
    """One that the model has already is not named again; an entry without a size is none."""
    setting, fit = _case(0, 0.01, 30.0, 6.0)
    (place,) = setting.places.inputs
    stated = BroadbandVibration(place, rms=rms, centre_hz=30.0, bandwidth_hz=6.0)
    assert len(broadband(replace(setting, known=(stated,)), fit)) == found


def test_none_is_found_in_coloured_noise_alone() -> None:
    """Of sixty records none reaches one in five hundred, which happens once in nine times at that very rate."""
    values = []
    for seed in range(60):
        found = broadband(*_case(200 + seed, 0.0, 30.0, 6.0))
        values.append(min((c.p_value for c in found), default=1.0))
    assert np.sum(np.array(values) < 0.002) <= 1


def test_the_ring_of_a_start_is_no_vibration() -> None:
    """Bare of its start, the residual of a record that begins in swing is noise."""
    for seed in range(5):
        rng = np.random.default_rng(700 + seed)
        force = np.repeat(rng.uniform(-1.0, 1.0, N // 400), 400)
        ring = moved(np.where(np.arange(N) < 7, 30.0, 0.0))
        assert np.max(np.abs(ring)) > 100.0 * 0.01  # far above the noise
        residual = _noise(rng) + np.append(ring[7:], np.zeros(7))
        found = broadband(*setting_of(force, moved(force) + residual, residual, 0.01))
        assert all(c.p_value > 0.002 for c in found)


@pytest.mark.parametrize(("centre_hz", "width_hz"), [(8.0, 2.0), (60.0, 15.0), (120.0, 20.0)])
def test_a_hum_of_a_reading_is_never_sure_to_be_a_torque(centre_hz: float, width_hz: float) -> None:
    """Where it does not pass through the plant, a band is noise of the reading as well, or nothing is said."""
    for seed in range(3):
        rng = np.random.default_rng(950 + seed)
        force = np.repeat(rng.uniform(-1.0, 1.0, N // 400), 400)
        residual = _noise(rng) + 0.01 * _band(rng, centre_hz, width_hz)
        for cause in broadband(*setting_of(force, moved(force) + residual, residual, 0.01)):
            assert dict(cause.rivals)["noise of a reading in a band"] < math.log(99.0)


def test_a_torque_of_all_frequencies_is_never_sure_to_be_a_band() -> None:
    """Amplifier noise, a very wide band and a rounded command look alike: they are tied, or nothing is said."""
    for seed in range(5):
        rng = np.random.default_rng(900 + seed)
        force = np.repeat(rng.uniform(-1.0, 1.0, N // 400), 400)
        residual = _noise(rng) + moved(0.05 * rng.standard_normal(N))
        for cause in broadband(*setting_of(force, moved(force) + residual, residual, 0.01)):
            assert {name for name, gap in cause.rivals if gap < math.log(99.0)} >= {
                "amplifier-noise",
                "command-quantisation",
            }


@pytest.mark.parametrize("corner_hz", [3.0, 10.0, 30.0, 80.0])
def test_an_amplifier_that_is_noisy_below_a_corner_is_never_sure_to_be_a_band(corner_hz: float) -> None:
    """Nothing is said of it, or it is tied with the noise of an amplifier, however strong it is."""
    keep = math.exp(-2.0 * math.pi * corner_hz / RATE_HZ)
    for seed in range(5):
        rng = np.random.default_rng(1200 + seed)
        force = np.repeat(rng.uniform(-1.0, 1.0, N // 400), 400)
        shake = lfilter([math.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(N + 2000))[2000:]
        residual = _noise(rng) + moved(0.05 * shake)
        for cause in broadband(*setting_of(force, moved(force) + residual, residual, 0.01)):
            assert dict(cause.rivals)["amplifier-noise"] < math.log(99.0)


def test_what_shakes_only_while_much_is_played_is_no_vibration() -> None:
    """It belongs to the motion then, and not to the surroundings."""
    rng = np.random.default_rng(10)
    force = np.repeat(np.where(np.arange(N // 4000) % 2 == 0, 0.02, 1.0), 4000)
    residual = _noise(rng) + moved(force * 0.03 * _band(rng, 30.0, 6.0))
    assert broadband(*setting_of(force, moved(force) + residual, residual, 0.01)) == []


@pytest.mark.parametrize("repeats", [True, False])
def test_what_repeats_with_what_is_played_is_no_vibration(repeats: bool) -> None:
    """It is an error of the model then, which looks like a band of noise where nothing is played twice."""
    rng = np.random.default_rng(12)
    half, period = N // 2, N // 8
    force = np.concatenate([np.tile(rng.uniform(-1.0, 1.0, period), 4), rng.uniform(-1.0, 1.0, half)])
    shake = 0.02 * _band(rng, 30.0, 6.0)
    if repeats:
        shake[:half] = np.tile(shake[:period], 4)
    residual = _noise(rng) + moved(shake)
    setting, fit = setting_of(force, moved(force) + residual, residual, 0.01, period)
    (record,) = setting.data.records
    windows = (Window("multisine", 0, half, period=period), Window("loops", half, N))
    setting = replace(setting, data=replace(setting.data, records=(replace(record, windows=windows),)))
    assert len(broadband(setting, fit)) == (0 if repeats else 1)


@pytest.mark.parametrize("steep", [True, False])
def test_the_resonator_has_unit_variance_and_its_width(steep: bool) -> None:
    """By the trapezoid rule, and half the height at half the width beside the centre of a narrow band."""
    f = np.linspace(0.0, 20_000.0, 4_000_001)
    spectrum = resonator(f, 40.0, 2.0, steep)
    # the flanks beyond 20 kHz hold 2 · width / (2π f) = 2e-5 of a flat band's
    assert np.trapezoid(spectrum, f) == pytest.approx(1.0, abs=1e-4)
    half = resonator(np.array([39.0, 40.0, 41.0]), 40.0, 2.0, steep)
    # the mirror band, or the slope of the far pole, changes the height by the ratio of width and centre
    assert 0.5 * (half[0] + half[2]) / half[1] == pytest.approx(0.5, abs=0.01)
