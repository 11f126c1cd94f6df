"""Limits where the answer is known in closed form, and noise that is what its filter says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.challenge.second.along import first_order
from analysis.challenge.second.campaign import Campaign, draw_campaign
from analysis.challenge.second.excite import Record, Stretch
from analysis.challenge.second.integrate import Placed
from analysis.challenge.second.laws import LAWS
from analysis.challenge.second.limits import THRESHOLD, Metric, left_by, limits_of
from analysis.challenge.second.noise import Noise, draw_noise
from analysis.challenge.second.plant import Plant

N, RATE_HZ, SIGMA = 8000, 1000.0, 1e-3


def bench(control: np.ndarray | None = None) -> Campaign:
    """One axis at 20 Hz under lines that do not come near 71 Hz, white noise."""
    omega = 2.0 * np.pi * np.array([20.0])
    plant = Plant("rad", omega, 0.1 * omega, np.array([[2.0]]), np.ones((1, 1)), 0.0)
    t = np.arange(N) / RATE_HZ
    wave = sum(np.sin(2.0 * np.pi * f * t + f) for f in (5.0, 11.0, 19.0, 23.0, 40.0))
    record = Record(
        (Stretch("sines", N - 2000, 1.0, {}), Stretch("held-out", 2000, 1.0, {})), np.asarray(wave)[:, None]
    )
    return replace(
        draw_campaign(np.random.default_rng(0), 1),
        plant=plant,
        rate_hz=RATE_HZ,
        records=(record,),
        scale=np.array([10.0 if control is None else 1e-3]),
        control=control,
        noises=(Noise("white", SIGMA, np.ones(1), np.ones(1)),),
        noise=(np.zeros((N, 1)),),
        louder=0.0,
        starts=(np.zeros((1, 2)),),
    )


def hum(size: float) -> Placed:
    return Placed(LAWS["hum"], np.array([size, 2.0 * np.pi * 71.0, 0.3]), 0, 0)


def gain_at(omega_rad_s: float) -> float:
    return abs(2.0 / ((2.0 * np.pi * 20.0) ** 2 - omega_rad_s**2 + 2j * 0.1 * 2.0 * np.pi * 20.0 * omega_rad_s))


@pytest.mark.parametrize("control", [None, np.array([[1500.0, 0.0, 30.0, 0.5]])])
def test_a_line_is_seen_at_the_size_that_a_sine_in_white_noise_is(control: np.ndarray | None) -> None:
    """d² = rows (size · gain)² / 2 σ², on the rows that may be fitted; a loop does not change what is known."""
    campaign = bench(control)
    limits = limits_of(hum(10.0), Metric(campaign, campaign.play([])), np.random.default_rng(0))
    expected = THRESHOLD * SIGMA * np.sqrt(2.0 / 6000.0) / gain_at(2.0 * np.pi * 71.0)
    # the search ends within 5 %; what the transient's start adds is below that
    assert limits.detection == pytest.approx(expected, rel=0.08)
    assert limits.naming >= limits.detection


def test_a_gain_of_the_sensor_has_the_gain_of_the_drive_for_a_twin() -> None:
    campaign = bench()
    one = Placed(LAWS["reading-gain"], np.array([0.1]), 0, 0)
    limits = limits_of(one, Metric(campaign, campaign.play([])), np.random.default_rng(0))
    assert "actuator-gain" in limits.twins
    # below the noise of what is known of gains (drive and shape of one mode) nothing can be seen
    assert limits.detection > 0.5 * THRESHOLD * np.sqrt(2.0) * 0.05 / np.sqrt(3.0)


def test_what_the_nominal_numbers_explain_is_taken_out() -> None:
    """A change of one nominal number by one prior is charged about 1 and no more, whatever it is in noise."""
    campaign = bench()
    metric = Metric(campaign, campaign.play([]))
    plant = replace(campaign.plant, drive=campaign.plant.drive * (1.0 + 0.05 / np.sqrt(3.0)))
    assert 0.5 < float(np.linalg.norm(metric.linear_left(plant))) < 1.01


def test_what_others_leave_is_the_distance_from_their_span() -> None:
    rng = np.random.default_rng(1)
    vector, others = rng.standard_normal(50), rng.standard_normal((50, 3))
    weights = np.linalg.lstsq(others, vector, rcond=None)[0]
    assert left_by(vector, others) == pytest.approx(float(np.linalg.norm(vector - others @ weights)))
    assert left_by(vector, np.zeros((50, 0))) == pytest.approx(float(np.linalg.norm(vector)))


def test_noise_has_its_size_and_is_white_when_filtered_back() -> None:
    slopes = set()
    for seed in range(12):
        noise = draw_noise(np.random.default_rng(seed), 2e-3)
        slopes.add(noise.slope)
        x = noise.draw(200_000, np.random.default_rng(seed))
        assert np.std(x) == pytest.approx(2e-3, rel=0.25)  # slow noise has few independent samples
        white = noise.whiten(x)[1000:]
        assert np.std(white) == pytest.approx(1.0, rel=0.02)
        assert abs(np.mean(white[1:] * white[:-1])) < 0.02
    assert slopes == {"white", "1/f", "1/f^2", "hump"}


def test_a_small_lag_of_one_drive_has_a_delay_of_that_drive_for_a_rival() -> None:
    """To first order both are a derivative of the command; what tells them apart is (ω τ)² / 2, at ω τ below 0.1."""
    campaign = replace(bench(), noises=(Noise("white", 1e-6, np.ones(1), np.ones(1)),))
    metric = Metric(campaign, campaign.play([]))
    lag = Placed(LAWS["lagging-amplifier"], np.array([4e-4]), 0, 0, 2500.0)
    left = metric.left([lag])
    assert left is not None
    delay = Placed(LAWS["later-drive"], np.array([4e-4]), 0, 0)
    own = float(np.linalg.norm(left.vector))
    assert left_by(left.vector, left.projection.beyond(metric.first_order(delay)[:, None])) < 0.1 * own


def test_a_delay_at_one_axis_is_that_of_its_own_drive() -> None:
    """Two axes without cross terms: where a rival delays one drive, the other axis reads what it read."""
    one = bench()
    plant = replace(one.plant, drive=np.diag([2.0, 2.0]), shape=np.eye(2))
    plant = replace(plant, omega=np.repeat(plant.omega, 2), decay=np.repeat(plant.decay, 2))
    (record,) = one.records
    two = replace(
        one,
        plant=plant,
        records=(replace(record, wave=np.repeat(record.wave, 2, axis=1)),),
        scale=np.repeat(one.scale, 2),
        noises=one.noises * 2,
        noise=(np.zeros((N, 2)),),
        starts=(np.zeros((2, 2)),),
    )
    change = first_order(Placed(LAWS["later-drive"], np.array([4e-4]), 1, 0), two, two.play([])[0], 0)
    assert np.max(np.abs(change[:, 0])) == 0.0
    assert np.max(np.abs(change[:, 1])) > 0.0
