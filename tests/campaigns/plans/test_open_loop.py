"""End stops, hysteresis, multisines and free runs: what they play, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.plans import checked_segments, make_plan
from campaigns.plans.waveform import Waveform, read_waveform
from sim_backend.errors import ConfigError, DataError
from sim_backend.simbench import SimBench
from tests.small_bench import bench_model


def test_end_stops_are_pulled_at_in_all_eight_ways(bench):
    plan = make_plan("endstops", {"current_a": 5.0})
    holds = [s for s in checked_segments(plan, bench) if s.settings["phase"] == "hold"]
    currents = np.array([(s.feedforward @ bench.limits.to_current.T)[0] for s in holds])
    np.testing.assert_allclose(np.abs(currents), 5.0, rtol=1e-12)
    assert len({tuple(np.sign(c)) for c in currents}) == 8
    assert [s.settings["signs"] for s in holds] == ["".join("+" if i > 0 else "-" for i in c) for c in currents]
    assert plan.channels(bench) == ("head_S1", "head_S2", "head_S3")


def test_the_pull_never_jumps(bench):
    segments = list(checked_segments(make_plan("endstops", {"current_a": 5.0, "ramp_s": 0.5}), bench))
    whole = np.vstack([np.resize(s.feedforward, (s.n_samples, 3)) for s in segments])
    current = np.vstack([np.zeros((1, 3)), whole]) @ bench.limits.to_current.T
    # half a cosine over 10 A in 5000 samples rises by at most 10 · pi / (2 · 5000) per sample
    assert np.max(np.abs(np.diff(current, axis=0))) <= 10.0 * np.pi / 10_000.0
    np.testing.assert_allclose(current[-1], 0.0, atol=1e-15)


def test_fed_forward_steps_arrive_at_every_offset_of_a_linear_plant(design_path):
    bench = SimBench(bench_model(), 0)
    offsets = (0.0, 3.5e-3, 5.3e-3)
    settings = {"model": design_path, "torques_nm": [], "offsets_rad": offsets, "settle_s": 3.0}
    for segment in checked_segments(make_plan("hysteresis", settings), bench):
        angle = bench.play(segment).channels["theta_x"]
        if segment.settings["phase"] == "step":
            wanted = float(segment.settings["offset_rad"]) + 1e-3
            # the approach in half a cosine of 15 periods leaves 5.3 mrad / (4 · 15² - 1) = 6 µrad ringing, of which
            # 3 s of e^(-4.7 t) leave 5 prad
            np.testing.assert_allclose(angle[50:], wanted, atol=1e-11)
    np.testing.assert_allclose(angle[-1], 0.0, atol=1e-11)


def test_steps_are_repeated_offset_by_offset(bench, design_path):
    settings = {"model": design_path, "torques_nm": [], "offsets_rad": [0.0, 1e-3], "repeats": 3}
    steps = [s for s in checked_segments(make_plan("hysteresis", settings), bench) if s.settings["phase"] == "step"]
    assert [s.settings["offset_rad"] for s in steps] == [0.0, 1e-3] * 3
    assert len({s.label for s in steps}) == 6


def test_loops_are_slow_sines_of_their_amplitude(bench, design_path):
    plan = make_plan("hysteresis", {"model": design_path, "offsets_rad": [], "frequency_hz": 0.5, "cycles": 3})
    for segment, torque_nm in zip(checked_segments(plan, bench), (0.05, 0.08, 0.095), strict=True):
        n = np.arange(20_000)
        np.testing.assert_allclose(segment.feedforward[:, 0], torque_nm * np.sin(2 * np.pi * n / 20_000), atol=1e-15)
        assert segment.n_samples == 60_000 and not segment.feedforward[:, 1:].any()


def test_multisines_have_their_rms_their_band_and_orthogonal_inputs(bench):
    settings = {"period_s": 0.1, "start_hz": 20.0, "stop_hz": 500.0, "realisations": 2, "torque_rms_nm": 0.02}
    segments = list(checked_segments(make_plan("multisine", settings), bench))
    assert [s.label for s in segments[:3]] == ["multisine 1.1", "multisine 1.2", "multisine 1.3"]
    assert sum("held-out" in s.label for s in segments) == 3
    rms = np.array([0.02, 0.02, 0.1])
    for first in range(0, 9, 3):
        gain = 0.6 if "held-out" in segments[first].label else 1.0
        waves = np.stack([s.feedforward for s in segments[first : first + 3]])
        np.testing.assert_allclose(np.sqrt(np.mean(waves**2, axis=1)), np.tile(rms * gain, (3, 1)), rtol=1e-12)
        spectrum = np.fft.rfft(waves, axis=1) / waves.shape[1]
        lines = np.arange(spectrum.shape[1]) * 10.0
        inside = (lines >= 20.0) & (lines <= 500.0)
        np.testing.assert_allclose(spectrum[:, ~inside], 0.0, atol=1e-15)
        for k in np.flatnonzero(inside):
            unit = spectrum[:, k] / (rms * gain) * np.sqrt(2.0 * np.count_nonzero(inside) / 3.0)
            # rows are experiments: a unitary matrix has them orthonormal
            np.testing.assert_allclose(unit @ unit.conj().T, np.eye(3), atol=1e-12)


def test_realisations_differ_and_seeds_repeat(bench):
    def waves(seed):
        return [s.feedforward for s in checked_segments(make_plan("multisine", {"period_s": 0.1, "seed": seed}), bench)]

    again = waves(1)
    for first, second in zip(waves(1), again, strict=True):
        np.testing.assert_array_equal(first, second)
    assert np.max(np.abs(again[0] - again[3])) > 1e-3 and np.max(np.abs(again[0] - waves(2)[0])) > 1e-3


def test_a_free_run_holds_out_another_size_and_another_form(bench):
    segments = {s.label: s for s in checked_segments(make_plan("freerun", {}), bench)}
    assert list(segments) == ["steps", "noise", "held-out steps", "held-out multisine"]
    steps = segments["steps"].feedforward[:, 0]
    assert np.max(np.abs(steps)) <= 0.045 and np.max(np.abs(segments["held-out steps"].feedforward)) <= 0.7 * 0.1
    np.testing.assert_allclose(np.sqrt(np.mean(segments["noise"].feedforward ** 2, axis=0)), [9e-3, 9e-3, 0.02])
    spectrum = np.abs(np.fft.rfft(segments["noise"].feedforward[:, 0]))
    above = np.fft.rfftfreq(segments["noise"].n_samples, 1e-4) > 200.0
    assert np.max(spectrum[above]) < 1e-9 * np.max(spectrum)


def test_a_waveform_from_a_file_is_played_as_it_stands(bench, tmp_path):
    path = tmp_path / "wave.csv"
    values = np.array([[1e-3, 0.0], [2e-3, 0.01], [0.0, -0.01]])
    path.write_text("theta_y, z\n" + "\n".join(",".join(map(str, row)) for row in values))
    played = [bench.play(s).channels for s in checked_segments(Waveform(file=str(path), repeats=2), bench)]
    for name, column in (("command_theta_y", 0), ("command_z", 1)):
        np.testing.assert_array_equal(np.concatenate([p[name] for p in played]), np.tile(values[:, column], 2))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("theta_x\n1.0\nnan\n", "row 3, column theta_x is not finite"),
        ("theta_x,z\n1.0\n", "name every column once"),
        ("theta_x\nhello\n", "cannot be read"),
        ("theta_x,theta_x\n1,2\n", "name every column once"),
        ("", "cannot be read|at least"),
    ],
)
@pytest.mark.filterwarnings("ignore:loadtxt")
def test_a_file_that_is_no_waveform_is_refused_by_name(tmp_path, text, says):
    path = tmp_path / "wave.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=says) as error:
        read_waveform(path)
    assert "wave.csv" in str(error.value) and "\n" not in str(error.value)


def test_a_waveform_for_an_axis_that_is_not_there_is_refused(bench, tmp_path):
    path = tmp_path / "wave.csv"
    path.write_text("phi\n1.0\n")
    with pytest.raises(ConfigError, match="no axis 'phi'"):
        list(checked_segments(Waveform(file=str(path)), bench))
