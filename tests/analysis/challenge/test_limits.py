"""Limits against closed forms that hold whatever the campaign, and bounds against what estimates really scatter by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm

from analysis.challenge.bounds import bound_deviations, held_out_floor
from analysis.challenge.campaign import Campaign
from analysis.challenge.families import FAMILIES
from analysis.challenge.families.drive import ActuatorGain
from analysis.challenge.families.sensor import ApexNoise, SensorDrift, SensorGain, SensorRotation
from analysis.challenge.families.structure import InertiaShift, StiffnessShift
from analysis.challenge.families.surroundings import BroadbandVibration, ConstantTorque
from analysis.challenge.limits import THRESHOLD, Distances, Rivals, detection_limit, limits_of
from analysis.challenge.metric import PRIOR_SD, Metric
from analysis.challenge.power import energy_beyond_amplifiers, random_energy


@pytest.fixture(scope="module")
def metric(short_one: Campaign) -> Metric:
    return Metric.of(short_one)


def test_threshold_detects_half_at_one_per_cent_false_alarms() -> None:
    assert 2.0 * norm.sf(THRESHOLD) == pytest.approx(0.01)
    assert norm.sf(THRESHOLD, loc=THRESHOLD) == pytest.approx(0.5)


def test_stiffness_is_seen_against_its_nominal_error_alone(short_one: Campaign, metric: Metric) -> None:
    # the record fixes the frequency far better than the nominal model is known, so d is the change of ln omega over the
    # prior's deviation: 2 ln omega changes by ln(1 + size)
    found = detection_limit(StiffnessShift(0, 0.05, 1.0), metric, short_one.scene())
    assert found == pytest.approx(np.expm1(2.0 * THRESHOLD * PRIOR_SD), rel=0.03)


def test_damping_takes_its_part_of_an_inertia_that_only_the_nominal_numbers_show(
    short_one: Campaign, metric: Metric
) -> None:
    # Smaller by the part s an inertia turns ω², σ and b of its mode by 1/(1 - s), each known beforehand to sd, b with
    # the reading's participation to √2 sd. A shift of damping is the whole of what happens to σ.
    inertia, size = InertiaShift(0, 0.1, -1.0), 0.15
    off = -np.log1p(-size) / PRIOR_SD
    distances, scene = Distances(inertia, metric, ()), short_one.scene()
    rivals = Rivals.of(inertia, metric, scene, np.random.default_rng(0))
    distances.alone(0.01)  # from where the nominal numbers are followed
    assert distances.alone(size) == pytest.approx(off * np.sqrt(1.0 / 4.0 + 1.0 + 1.0 / 2.0), rel=0.03)
    left = distances.beyond_one(rivals, ("damping-shift", "theta_x"), size)
    assert left == pytest.approx(off * np.sqrt(1.0 / 4.0 + 1.0 / 2.0), rel=0.03)
    limits = limits_of(inertia, metric, scene, np.random.default_rng(0))
    assert limits.rival == "damping-shift" and limits.naming > 1.3 * limits.detection


def test_gains_of_drive_and_sensor_are_twins(short_one: Campaign, metric: Metric) -> None:
    limits = limits_of(ActuatorGain(0, 0.1, 1.0), metric, short_one.scene(), np.random.default_rng(0))
    assert ("sensor-gain", "theta_x") in limits.twins
    # A mode's gain is the product of two nominal numbers, so its logarithm is known to √2 sd; the two modes of the axis
    # are wrong independently, and to change both by ln(1 + size) costs 2 · (ln(1 + size))² / (2 sd²) of d².
    assert limits.detection == pytest.approx(np.expm1(THRESHOLD * PRIOR_SD), rel=0.03)
    assert limits.naming >= limits.detection


def test_gains_of_two_sensors_are_no_twins(short_two: Campaign) -> None:
    scene = short_two.scene()
    limits = limits_of(SensorRotation(0, 0.05, 1, 1.0), Metric.of(short_two), scene, np.random.default_rng(0))
    assert "sensor-gain" not in {slug for slug, _ in limits.twins}
    assert limits.naming < SensorRotation(0, 0.05, 1, 1.0).cap(scene)


def test_drift_of_a_long_record_is_seen_as_theory_says(short_one: Campaign, metric: Metric) -> None:
    # without nuisances d² of a known signature s is s'C⁻¹s; a drift looks like no resonance, so nearly all of it is
    # left
    noise, run = short_one.noises[0], short_one.runs[0]
    time_s = np.arange(run.excitation.n) / run.excitation.rate_hz
    white = noise.whiten(time_s[:, None])[run.rows(held_out=False), 0]
    bound = THRESHOLD / float(np.linalg.norm(white))
    found = detection_limit(SensorDrift(0, 0.1 * bound, 1.0), metric, short_one.scene())
    assert bound * 0.98 < found < bound * 1.2


def test_distance_of_growing_noise_is_that_of_its_variance(short_one: Campaign) -> None:
    scene = short_one.scene()
    effect = ApexNoise(0, 1e-3 * float(scene.noise_std[0] / scene.y_rms[0]))
    # d² = ½ Σ r² with r ∝ size² grows with the fourth power while r is small
    ratio = random_energy(effect.resized(2.0 * effect.size), short_one) / random_energy(effect, short_one)
    assert ratio == pytest.approx(16.0, rel=1e-3)


@pytest.fixture(scope="module")
def weak_band(short_one: Campaign, metric: Metric) -> BroadbandVibration:
    band = BroadbandVibration(0, 1e-6, 40.0, 12.0)
    return band.resized(detection_limit(band, metric, short_one.scene()))


def test_what_an_amplifier_leaves_of_a_vibration_is_the_distance_of_the_nearest_spectrum(
    short_one: Campaign, weak_band: BroadbandVibration
) -> None:
    # Whittle's expected likelihood ratio of two spectra is ½ Σ (q - 1 - ln q) per number, q their ratio, and d² twice
    # that; the nearest is looked for over level and corner of the amplifier and six terms of the noise's colour
    rate_hz, substeps = short_one.runs[0].excitation.rate_hz, short_one.runs[0].excitation.substeps
    f = (np.arange(4096, dtype=float) + 0.5) * rate_hz / 8192.0
    numerator, denominator = weak_band.filter(1.0 / (rate_hz * substeps))
    z = np.exp(-2j * np.pi * f / (rate_hz * substeps))
    torque = weak_band.size**2 * np.abs(numerator[0] / np.polyval(denominator[::-1], z)) ** 2 / substeps
    gain = np.abs(short_one.plant.response(f)[:, 0, 0]) ** 2
    floor = short_one.noises[0].density(f, rate_hz)
    at = np.log(f)
    terms = np.polynomial.chebyshev.chebvander(2.0 * (at - at[0]) / (at[-1] - at[0]) - 1.0, 5)
    samples = sum(int(run.rows(held_out=False).sum()) for run in short_one.runs)
    there, unit = floor + gain * torque, np.max(gain / floor)

    def distance(x):
        q = there / (floor * np.exp(terms @ x[:6]) + np.exp(x[6]) * gain / unit / (1.0 + (f / np.exp(x[7])) ** 2))
        return samples / 4096 * np.sum(q - 1.0 - np.log(q))

    starts = [np.array([*np.zeros(6), np.log(0.3), np.log(corner)]) for corner in (10.0, 40.0, 300.0, 3000.0)]
    nearest = min(minimize(distance, start, method="L-BFGS-B").fun for start in starts)
    assert nearest < 0.9 * random_energy(weak_band, short_one)
    assert energy_beyond_amplifiers(weak_band, short_one) == pytest.approx(nearest, rel=0.15)


def test_amplifiers_noise_is_a_rival_of_a_vibration_and_the_twin_of_a_white_one(
    short_one: Campaign, metric: Metric, weak_band: BroadbandVibration
) -> None:
    scene = short_one.scene()
    limits = limits_of(weak_band, metric, scene, np.random.default_rng(0))
    assert limits.rival == "amplifier-noise" and limits.twins == ()
    assert limits.detection < limits.naming < weak_band.cap(scene)
    white = replace(weak_band, bandwidth_hz=1e3 * short_one.runs[0].excitation.rate_hz)
    assert limits_of(white, metric, scene, np.random.default_rng(0)).twins == (("amplifier-noise", "theta_x"),)


def test_noise_that_grows_with_the_angle_has_no_rival(short_one: Campaign, metric: Metric) -> None:
    scene = short_one.scene()
    limits = limits_of(ApexNoise(0, 1e-3), metric, scene, np.random.default_rng(0))
    assert limits.naming == limits.detection < np.inf


@pytest.mark.parametrize("family", FAMILIES, ids=lambda f: f.__name__)
def test_signature_grows_with_the_size_and_place_and_name_hold(family, short_two: Campaign) -> None:
    metric, scene = Metric.of(short_two), short_two.scene()
    effect = family.draw(np.random.default_rng(1), scene)
    assert 0.0 < effect.size <= effect.cap(scene)
    assert set(effect.where.split("->")) <= {"theta_x", "theta_y"}
    if effect.random:
        small, large = (random_energy(effect.resized(s * effect.size), short_two) for s in (0.01, 0.02))
    else:
        # dropped samples are drawn anew at each size, so only their number tells: far apart
        small, large = (float(np.linalg.norm(metric.signature([effect.resized(s * effect.size)]))) for s in (0.1, 1.0))
    assert 0.0 < small < large


def test_bound_of_a_drift_is_what_its_best_estimate_scatters_by(short_one: Campaign, metric: Metric) -> None:
    effect = SensorDrift(0, 1e-4, 1.0)
    (bound,) = bound_deviations(metric, (effect,))
    # generalised least squares on noise alone: project onto the signature per unit, nuisances out
    unit = metric.signature([effect]) / effect.size
    reach = metric.seen(unit[:, None]).products()[0, 0]
    estimates = []
    for seed in range(200):
        noisy = replace(short_one, noise_seed=seed).noise()
        white = np.concatenate(
            [
                np.zeros(metric.tuned.size),
                *(
                    short_one.noises[0].whiten(drawn)[run.rows(held_out=False), 0]
                    for run, drawn in zip(short_one.runs, noisy, strict=True)
                ),
            ]
        )
        estimates.append(metric.seen(unit[:, None]).products(metric.seen(white[:, None]))[0, 0] / reach)
    # the relative scatter of a standard deviation from 200 draws is 1/√400 = 5 %; three of them
    assert np.std(estimates) == pytest.approx(bound["drift"], rel=0.15)


def test_two_sensors_gain_bound_holds_the_prior(short_one: Campaign) -> None:
    effect = SensorGain(0, 0.2, 1.0)
    (bound,) = bound_deviations(Metric.of(short_one, beside=(effect,)), (effect,))
    # the gain is known no better than the nominal gains it cannot be told from
    assert bound["relative"] > 0.5 * PRIOR_SD


def test_floor_of_the_truth_is_its_noise(short_one: Campaign) -> None:
    effect = ConstantTorque(0, 1e-3 * float(short_one.scene().u_rms[0]), 1.0)
    noise = short_one.noise()
    readings = short_one.readings((effect,), noise)
    rows = short_one.runs[0].rows(held_out=True)
    expected = np.sqrt(np.mean(noise[0][rows] ** 2)) / np.std(readings[0][rows])
    assert held_out_floor(short_one, (effect,), readings) == pytest.approx(expected, rel=1e-9)
