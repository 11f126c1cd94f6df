"""The stepped sine against the paper's resolution, against closed forms, and against the plant that it measures."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.plans import checked_segments, make_plan
from sim_backend.errors import ConfigError
from sim_backend.simbench import SimBench
from tests.small_bench import bench_model


def test_default_frequencies_are_those_of_the_paper(bench):
    played = [float(s.settings["frequency_hz"]) for s in checked_segments(make_plan("sinesweep", {}), bench)]
    # 5 Hz in 5–600 and 1400–1500 Hz, 50 Hz elsewhere up to 2 kHz
    wanted = [*range(5, 601, 5), *range(650, 1400, 50), *range(1400, 1501, 5), *range(1550, 2001, 50)]
    np.testing.assert_allclose(played, wanted, rtol=1e-12)


@pytest.mark.parametrize("frequency_hz", [5.0, 29.5, 33.0, 1440.0, 1995.0])
def test_every_segment_is_whole_cycles_of_its_frequency(bench, frequency_hz):
    band = {"start_hz": frequency_hz, "stop_hz": frequency_hz, "step_hz": 1.0}
    (segment,) = checked_segments(make_plan("sinesweep", {"bands": [band], "amplitude": 0.01}), bench)
    period = segment.feedforward.shape[0]
    n = np.arange(segment.n_samples)
    wave = segment.feedforward[n % period, 0]
    # rounding of the argument over at most 1e5 samples: 1e5 · 2 pi · 1e-16
    np.testing.assert_allclose(wave, 0.01 * np.sin(2 * np.pi * frequency_hz * n / 10_000.0), atol=1e-12)
    cycles = segment.n_samples * frequency_hz / 10_000.0
    assert cycles == pytest.approx(round(cycles), abs=1e-9)
    measured = (segment.n_samples - int(segment.settings["measure_from"])) * frequency_hz / 10_000.0
    assert measured == pytest.approx(round(measured), abs=1e-9) and measured >= 1.0


def test_steady_state_is_the_plants_response():
    model = bench_model()
    bench = SimBench(model, 0)
    band = {"start_hz": 20.0, "stop_hz": 50.0, "step_hz": 10.0, "settle_s": 5.0, "measure_s": 0.2}
    response = model.linear().frequency_response(np.array([20.0, 30.0, 40.0, 50.0]), 10_000.0)[:, 0, 0]
    for segment, expected in zip(
        checked_segments(make_plan("sinesweep", {"bands": [band]}), bench), response, strict=True
    ):
        angle = bench.play(segment).channels["theta_x"][int(segment.settings["measure_from"]) :]
        carrier = np.exp(-2j * np.pi * float(segment.settings["frequency_hz"]) * np.arange(angle.size) / 10_000.0)
        measured = 2.0 * np.mean(angle * carrier) / (-1j * float(segment.settings["amplitude"]))
        # after 5 s of e^(-4.7 t) the transient is 6e-11 of the response
        assert abs(measured - expected) < 1e-9 * abs(expected)


def test_only_the_first_segment_sets_the_temperature(bench):
    band = {"start_hz": 20.0, "stop_hz": 60.0, "step_hz": 20.0}
    plan = make_plan("sinesweep", {"bands": [band], "cold_finger_k": 63.5})
    assert [s.cold_finger_k for s in checked_segments(plan, bench)] == [63.5, None, None]


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"axis": "phi"}, "no axis 'phi'; its axes are theta_x, theta_y, z"),
        ({"amplitude": -1.0}, "amplitude is -1.0"),
        ({"amplitude": 100.0}, "feed-forward asks for .* A, an amplifier gives 9 A"),
        ({"bands": [{"start_hz": 10.0, "stop_hz": 5.0, "step_hz": 1.0}]}, "from 10 to 5 Hz"),
        ({"bands": [{"start_hz": 5000.0, "stop_hz": 5000.0, "step_hz": 1.0}]}, "5000 Hz at a sample rate of 10000"),
        ({"bands": [{"start_hz": 3.14159265, "stop_hz": 3.2, "step_hz": 1.0}]}, "no whole cycles"),
    ],
)
def test_what_cannot_be_played_is_refused(bench, settings, says):
    with pytest.raises(ConfigError, match=says):
        list(checked_segments(make_plan("sinesweep", settings), bench))
