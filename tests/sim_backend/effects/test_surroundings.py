"""Effects of the surroundings against closed forms, scipy's filters and statistics."""

import math

import numpy as np
import pytest
from scipy.signal import welch

from sim_backend.bench import Segment
from sim_backend.effects import make_effect
from sim_backend.errors import ConfigError
from sim_backend.model import EffectEntry
from sim_backend.simbench import SimBench
from tests.contract.test_effects import three_axes
from tests.sim_backend.effects.along import along
from tests.sim_backend.test_kernel import INERTIA_KGM2, OMEGA, RATE_HZ, STIFFNESS_NM_RAD, one_axis, play


def test_vibration_line_is_a_sine_that_keeps_its_phase():
    effect = make_effect("vibration-line", "theta_x", {"cosine": 3e-4, "sine": 4e-4, "frequency_hz": 49.7})
    n = 200_000
    t = np.arange(n) * 1e-4
    expected = 3e-4 * np.cos(2 * np.pi * 49.7 * t) + 4e-4 * np.sin(2 * np.pi * 49.7 * t)
    # n additions, each rounded to 1e-16 of a period
    np.testing.assert_allclose(
        along(effect, position=np.zeros(n)), expected, rtol=0, atol=5e-4 * 2 * np.pi * n * 1.2e-16
    )


@pytest.mark.parametrize("substeps", [1, 4])
def test_vibration_line_moves_the_bench_as_its_transfer_function_says(substeps):
    f_hz, torque_nm = 80.0, 1e-3
    model = one_axis([("vibration-line", {"sine": torque_nm, "frequency_hz": f_hz})], sigma=60.0)
    theta = play(model, np.zeros(4000), substeps=substeps)["theta_x"][2000:]
    s = 2j * np.pi * f_hz
    got = 2 * np.mean(theta * np.exp(-s * (np.arange(2000, 4000) / RATE_HZ)))  # 16 whole periods
    expected = -1j * torque_nm / INERTIA_KGM2 / (s**2 + 120 * s + OMEGA**2)
    # torque held at its value extrapolated to mid-step: an error of 3/8 (omega dt)² for the extrapolation and 1/24 for
    # the hold
    assert abs(got / expected - 1) < 0.5 * (2 * np.pi * f_hz / RATE_HZ / substeps) ** 2 + 1e-6


def test_broadband_vibration_has_its_rms_and_its_band():
    rms, centre, width, n = 2e-4, 300.0, 60.0, 2**20
    effect = make_effect("broadband-vibration", "theta_x", {"rms": rms, "centre_hz": centre, "bandwidth_hz": width})
    out = along(effect, position=np.zeros(n), aux=effect.draw(n, RATE_HZ, np.random.default_rng(0)))
    # width · duration = 6000 independent values: 0.9 % scatter of the standard deviation; (pi f / f_s)²/6 is missing
    assert np.std(out) == pytest.approx(rms, rel=4 * 0.009 + 0.002)
    f_hz, density = welch(out, RATE_HZ, nperseg=8192)
    s = 2j * np.pi * f_hz
    # Re of 1/(s + decay - j omega) for a real input: (s + decay) / ((s + decay)² + omega²)
    decay, omega = math.pi * width, 2 * math.pi * centre
    shape = np.abs((s + decay) / ((s + decay) ** 2 + omega**2)) ** 2
    expected = rms**2 * shape / (np.sum(shape) * f_hz[1])
    near = (f_hz > 100) & (f_hz < 600)
    # about 255 overlapping averages: each density scatters by 1/sqrt(128…255) = 9 %, their mean over 400 bins by 0.5 %
    ratio = density[near] / expected[near]
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.03)
    assert np.max(np.abs(ratio - 1)) < 6 * 0.09


def test_broadband_vibration_is_the_same_for_finer_steps():
    effect = make_effect("broadband-vibration", "theta_x", {"rms": 1.0, "centre_hz": 100.0, "bandwidth_hz": 30.0})
    aux = effect.draw(2000, RATE_HZ, np.random.default_rng(1))
    coarse = along(effect, position=np.zeros(2000), aux=aux, dt_s=1 / RATE_HZ)
    fine = along(effect, position=np.zeros(8000), aux=np.repeat(aux, 4), dt_s=0.25 / RATE_HZ)[::4]
    np.testing.assert_allclose(fine, coarse, rtol=0, atol=1e-10)


def test_thermal_drift_changes_the_rest_position():
    coefficient, torque_nm = 0.02, 0.05
    parameters = {"coefficient": coefficient, "reference_k": 77.0}
    model = one_axis([("thermal-stiffness-drift", parameters)], sigma=60.0)
    theta = play(model, np.full(6000, torque_nm))["theta_x"]
    # a bench without hardware stands at 293.15 K
    assert theta[-1] == pytest.approx(torque_nm / (STIFFNESS_NM_RAD + coefficient * (293.15 - 77.0)), rel=1e-9)


def test_thermal_drift_follows_the_temperature_channel():
    effect = make_effect("thermal-stiffness-drift", "theta_x", {"coefficient": 0.02, "reference_k": 70.0})
    x, temperature = np.array([1e-3, -2e-3]), np.array([63.5, 77.0])
    np.testing.assert_allclose(along(effect, position=x, aux=temperature), [0.02 * 6.5e-3, 0.02 * 14e-3], rtol=1e-13)


def test_a_fit_leaves_the_reference_temperature_alone():
    cls = type(make_effect("thermal-stiffness-drift", "theta_x", {}))
    assert cls.shapes() == () and [p.name for p in cls.parameters() if p.fixed] == ["reference_k"]


@pytest.mark.parametrize("relative", [1e-4, -3e-3])
def test_clock_error_stretches_time(relative):
    f_hz, n = 60.0, 5000
    wave = np.sin(2 * np.pi * f_hz * np.arange(n) / RATE_HZ)
    got = make_effect("sample-clock-error", "theta_x", {"relative": relative}).rewrite(wave, RATE_HZ)
    at = np.arange(n) * (1 + relative)
    inside = at <= n - 1
    # a cubic through four points errs by (omega dt)⁴ · 3/128 at the middle, at the ends (extrapolated or not) by less
    # than 1/4 of (omega dt)⁴
    np.testing.assert_allclose(
        got[inside], np.sin(2 * np.pi * f_hz * at[inside] / RATE_HZ), rtol=0, atol=(2 * np.pi * f_hz / RATE_HZ) ** 4 / 4
    )
    np.testing.assert_array_equal(got[~inside], wave[-1])


def test_clock_error_reads_cubics_exactly():
    k = np.arange(50.0)
    cubic = 1 + k - 0.1 * k**2 + 0.003 * k**3
    got = make_effect("sample-clock-error", "theta_x", {"relative": -0.07}).rewrite(cubic, RATE_HZ)
    at = 0.93 * k
    np.testing.assert_allclose(got, 1 + at - 0.1 * at**2 + 0.003 * at**3, rtol=1e-12)


def test_dropped_samples_repeat_the_one_before():
    n, fraction = 20_000, 0.1
    values = np.arange(n, dtype=float)
    got = make_effect("dropped-samples", "theta_x", {"fraction": fraction}).rewrite(
        values, RATE_HZ, np.random.default_rng(0)
    )
    lost = got != values
    assert got[0] == 0.0
    np.testing.assert_array_equal(got[1:][lost[1:]], got[:-1][lost[1:]])
    # binomial scatter sqrt(p (1 - p) / n) = 0.2 %
    assert np.mean(lost) == pytest.approx(fraction, abs=5 * 0.0021)


def test_without_chance_nothing_is_dropped():
    values = np.arange(10.0)
    effect = make_effect("dropped-samples", "theta_x", {"fraction": 0.5})
    np.testing.assert_array_equal(effect.rewrite(values, RATE_HZ), values)


def test_every_segment_drops_other_samples_and_every_bench_of_a_seed_the_same():
    model = three_axes([EffectEntry(effect="dropped-samples", where="theta_x", parameters={"fraction": 0.3})])

    def two_segments():
        bench = SimBench(model, 5)
        quiet = Segment("quiet", 400, np.zeros((1, 3)), np.zeros((1, 3)))
        return [np.diff(bench.play(quiet).channels["theta_x"]) == 0.0 for _ in range(2)]

    first, again = two_segments(), two_segments()
    np.testing.assert_array_equal(first, again)
    assert np.any(first[0] != first[1])


def test_record_effects_belong_to_a_reading():
    with pytest.raises(ConfigError, match="there is no 's1' on this bench; locations: theta_x, theta_y, z"):
        SimBench(three_axes([EffectEntry(effect="dropped-samples", where="s1")]), 1)


def test_constant_torque_moves_the_rest_position():
    theta = play(one_axis([("constant-torque", {"torque": 1e-3})], sigma=60.0), np.zeros(6000))["theta_x"]
    assert theta[-1] == pytest.approx(1e-3 / STIFFNESS_NM_RAD, rel=1e-9)
