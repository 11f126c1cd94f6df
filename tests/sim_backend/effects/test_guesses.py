"""The starts that effects read off a record must lie near what made the record."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from sim_backend.effects import effect_class, make_effect
from sim_backend.effects.base import UNKNOWN_RUN
from sim_backend.effects.view import RecordView
from tests.sim_backend.effects.along import along

RATE_HZ = 10_000.0
N = 20_000
T_S = np.arange(N) / RATE_HZ


def view(residual=None, *, position=None, temperature_k=None):
    """A slow swing of 5 mrad about an offset, with a residual beside noise."""
    x = 2e-3 + 5e-3 * np.sin(2 * np.pi * 3.3 * T_S) if position is None else position
    noise = 1e-7 * np.random.default_rng(0).standard_normal(N)
    rest = noise if residual is None else residual + noise
    return RecordView(RATE_HZ, 0.05 * np.ones(N), x, np.gradient(x, 1 / RATE_HZ), rest, temperature_k, 29.6)


@pytest.mark.parametrize("slug", ["vibration-line", "extra-resonance", "broadband-vibration"])
def test_a_line_is_found_within_the_resolution_of_the_record(slug):
    f_hz = 123.37
    starts = effect_class(slug).guess(view(3e-7 * np.sin(2 * np.pi * f_hz * T_S)))
    name = "centre_hz" if slug == "broadband-vibration" else "frequency_hz"
    assert min(abs(start[name] - f_hz) for start in starts) <= 0.5 * RATE_HZ / N + 1e-9


def test_a_line_may_be_elsewhere_at_the_start_of_each_run():
    """Three runs of 0.5, 0.9 and 0.6 s: the phase of each in its middle, whatever the guessed frequency is off by."""
    f_hz, ends, begin = 123.4, (5000, 14_000, 20_000), (0.1, 0.45, -0.3)
    parts = [
        np.sin(2 * np.pi * (f_hz * np.arange(stop - start) / RATE_HZ + turn))
        for start, stop, turn in zip((0, *ends[:-1]), ends, begin, strict=True)
    ]
    seen = replace(view(3e-7 * np.concatenate(parts)), ends=ends)
    for guess_hz in (f_hz, f_hz + 0.2):
        given = effect_class("vibration-line").given(seen, {"frequency_hz": guess_hz})
        line = effect_class("vibration-line")("theta_x", **{"frequency_hz": f_hz, **given})
        ahead = [line.in_run(run).start()[0] for run in range(3)]
        off = (np.array(ahead) - ahead[0] - np.array(begin) + begin[0] + 0.5) % 1.0 - 0.5
        assert np.max(np.abs(off)) < 0.01
    assert line.in_run(UNKNOWN_RUN).start()[0] == 0.0
    assert len({effect_class("vibration-line").choices(one) for one in (seen, view())}) == 2  # phases are paid for


def test_a_line_is_found_although_each_run_begins_elsewhere_in_it():
    """Half a period between two equal runs: in one spectrum of both nothing is left at the line. Drift is no line."""
    f_hz, half = 120.0, N // 2
    line = 2e-8 * np.sin(2 * np.pi * f_hz * T_S[:half])
    drift = 1e-6 * np.cumsum(np.random.default_rng(4).standard_normal(N)) / np.sqrt(N)
    seen = replace(view(np.concatenate([line, -line]) + drift), ends=(half, N))
    assert abs(seen.residual_lines_hz(1, 20.0)[0] - f_hz) <= RATE_HZ / N
    assert all(f > 20.0 for f in seen.residual_lines_hz(5, 20.0))


def test_a_line_is_found_beside_noise_in_a_band():
    """The band holds a hundred thousand times as much, and its own strongest lines are nothing but noise."""
    f_hz = 700.0
    pole = 0.999 * np.exp(2j * np.pi * 123.0 / RATE_HZ)
    shaken = lfilter([1.0], np.poly([pole, pole.conj()]).real, np.random.default_rng(5).standard_normal(N))
    residual = 1e-5 * shaken / np.std(shaken) + 3e-8 * np.sin(2 * np.pi * f_hz * T_S)
    starts = [start["frequency_hz"] for start in effect_class("vibration-line").guess(view(residual))]
    assert min(abs(f - f_hz) for f in starts) <= 0.5 * RATE_HZ / N + 1e-9


def test_what_stops_nothing_is_no_stop_and_what_is_mostly_loose_has_no_play():
    peak = view().position_peak
    stop, play = (effect_class(slug).limits(view())["gap"] for slug in ("end-stop-contact", "backlash"))
    assert stop == (0.5 * peak, np.inf) and play == (0.0, 0.5 * peak)
    named = {
        "end-stop-contact": "gap",
        "backlash": "gap",
        "hysteresis": "reach",
        "presliding-friction": "give",
    }
    for slug, name in named.items():
        for start in effect_class(slug).guess(view()):
            low, high = effect_class(slug).limits(view())[name]
            assert low <= start[name] <= high


def test_friction_gives_way_by_less_than_a_hysteresis_reaches():
    """The swing counts and not where it happens: a motion of ±5 mrad about 2 mrad."""
    give, reach = (effect_class(slug).limits(view()) for slug in ("presliding-friction", "hysteresis"))
    assert give["give"][1] == pytest.approx(reach["reach"][0] / 27.0) == pytest.approx(0.02 * 5e-3, rel=1e-6)


@pytest.mark.parametrize("slug", ["periodic-torque", "periodic-sensor-error"])
@pytest.mark.parametrize("period", [2.1e-3, 3.17e-4, 4.4e-5])
def test_a_period_is_found_so_near_that_a_fit_cannot_slip_by_one(slug, period):
    x = view().position
    effect = make_effect(slug, "theta_x", {"cosine": 2e-7, "sine": 1e-7, "period": period})
    smooth = 1e-6 + 3e-4 * x - 0.05 * x**2
    starts = effect_class(slug).guess(view(along(effect, position=x) + smooth))
    # over the range a phase error below half a turn: the sum of squares then has no other minimum on the way
    turns = [np.ptp(x) * abs(1 / start["period"] - 1 / period) for start in starts]
    assert min(turns) < 0.5


@pytest.mark.parametrize("step", [2.1e-4, 3.17e-5])
def test_a_rounding_with_noise_behind_it_is_found_although_no_reading_lies_on_a_step(step):
    x = view().position
    effect = make_effect("sensor-quantisation", "theta_x", {"step_size": step})
    starts = effect_class("sensor-quantisation").guess(view(along(effect, signal=x)))
    assert min(np.ptp(x) * abs(1 / start["step_size"] - 1 / step) for start in starts) < 0.5


def test_the_period_of_a_force_is_found_through_the_plant_in_fast_motion():
    """A mode at 25 Hz moved by noise: the residual swings at 25 Hz wherever it is; the best distance must be right."""
    rng = np.random.default_rng(2)
    omega, period = 2 * np.pi * 25.0, 1.3e-3
    b, a, _ = cont2discrete(([1.0], [1.0, 0.04 * omega, omega**2]), 1 / RATE_HZ, method="zoh")
    x = lfilter(b[0], a, rng.standard_normal(N))
    x *= 2e-3 / x.std()
    residual = lfilter(b[0], a, 1e-3 * np.sin(2 * np.pi * x / period))
    sd = 0.3 * residual.std()
    residual += sd * rng.standard_normal(N)
    # the gradient of the likelihood under white noise: the residual through the plant backwards
    wanted = lfilter(b[0], a, residual[::-1])[::-1] / sd**2
    answer = lfilter(b[0], a, np.eye(1, N)[0])[:, None] / sd
    seen = RecordView(RATE_HZ, np.ones(N), x, np.gradient(x, 1 / RATE_HZ), residual, None, 25.0, wanted, answer)
    assert np.ptp(x) * abs(1 / seen.force_periods(1)[0] - 1 / period) < 0.5


def test_nothing_repeats_where_nothing_moves():
    assert view(position=np.full(N, 1e-3)).residual_periods(3) == []
    assert view(position=np.full(N, 1e-3)).force_periods(3) == []


def test_the_step_of_a_quantised_reading_is_found_exactly():
    q = 3e-6
    jump = np.where(T_S > 1, 0.02, 0.0)  # most levels are neighbours, some are never reached
    starts = effect_class("sensor-quantisation").guess(view(position=q * np.rint((view().position + jump) / q)))
    # differences of levels of 2e-2, each rounded to 1e-16 of itself
    assert min(abs(start["step_size"] - q) for start in starts) < 1e-17


def test_the_share_of_dropped_samples_is_found():
    x = view().position
    got = make_effect("dropped-samples", "theta_x", {"fraction": 0.05}).rewrite(x, RATE_HZ, np.random.default_rng(1))
    (start,) = effect_class("dropped-samples").guess(view(position=got))
    assert start["fraction"] == pytest.approx(0.05, abs=5 * np.sqrt(0.05 * 0.95 / N))
    assert effect_class("dropped-samples").guess(view()) == []


def test_thermal_drift_needs_a_temperature_and_takes_its_mean():
    cls = effect_class("thermal-stiffness-drift")
    assert cls.guess(view()) == []
    assert cls.guess(view(temperature_k=70 + np.sin(2 * np.pi * T_S))) == [{"reference_k": pytest.approx(70, abs=1e-6)}]


def test_the_step_of_a_rounded_command_is_found_where_it_is_held_and_where_it_moves_slowly():
    """Held levels and slow sweeps round alike for many samples: wrong steps agree with a few of them by chance."""
    rng = np.random.default_rng(5)
    held = np.repeat(rng.uniform(-0.05, 0.05, 12), 400)
    slow = 0.05 * np.sin(2 * np.pi * np.arange(6000) / 5000.0)
    u = np.concatenate([0.02 * rng.standard_normal(4000), held, slow])
    q = 3.217e-4
    rounded = q * np.floor(u / q + 0.5)
    pulse = 0.95 ** np.arange(200)
    error = 3000.0 * lfilter([1.0], [1.0, -0.95], rounded - u) + 4.0 * rng.standard_normal(u.size)
    wanted = 3000.0 * lfilter([1.0], [1.0, -0.95], error[::-1])[::-1] / 16.0
    seen = replace(view(), u=u, wanted=wanted, answer=3000.0 * pulse[:, None] / 4.0)
    # so near that the largest command is shifted by a tenth of a step against its lattice: a fit goes on from there
    assert abs(seen.likely_roundings(1)[0] / q - 1.0) < 0.1 * q / np.max(np.abs(u))
