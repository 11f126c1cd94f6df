"""From logs to a model: sweeps, periodic data and free records of a plant that is known."""

from __future__ import annotations

import csv
from contextlib import ExitStack

import numpy as np
import pytest

from analysis.identification.identify import identify_runs
from analysis.identification.response_curves import save_curves
from analysis.identification.summary import facts
from analysis.linear.simulate import simulate_linear
from campaigns.log import LogWriter, read_run
from campaigns.plans import make_plan
from campaigns.playing.runner import run_plan
from sim_backend.bench import Signal
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import discretise
from sim_backend.model import EffectEntry, dump_model, parse_model
from sim_backend.simbench import SimBench
from tests.small_bench import MODES, NOISE, bench_model

OUTPUTS = ("theta_x", "theta_y", "z")
INPUTS = tuple(f"command_{dof}" for dof in OUTPUTS)


def record(tmp_path, name, settings, effects=NOISE):
    path = tmp_path / f"{name}-{len(list(tmp_path.iterdir()))}.h5"
    run_plan(make_plan(name, settings), SimBench(bench_model(tuple(effects)), 2), path, seed=2)
    return path


def identify(*paths, **options):
    with ExitStack() as stack:
        return identify_runs([stack.enter_context(read_run(p)) for p in paths], **options)


def assert_true_modes(found, frequencies, decays):
    """Within five standard deviations, which are themselves small: a wrong model has both wrong."""
    for mode, frequency, decay in zip(found.modes, frequencies, decays, strict=True):
        assert abs(mode["frequency_hz"] - frequency) < 5 * mode["frequency_std_hz"] + 1e-5 * frequency
        assert abs(mode["decay_rate_1_s"] - decay) < 5 * mode["decay_rate_std_1_s"] + 1e-4 * decay
        assert mode["frequency_std_hz"] < 0.01 * frequency


SORTED = sorted(MODES.values())


def test_one_sweep_per_axis_gives_all_axes(tmp_path):
    # e^(-4.7 · 3) = 1e-6 of a transient is below the noise
    band = {"start_hz": 10.0, "stop_hz": 50.0, "step_hz": 4.0, "settle_s": 3.0}
    paths = [
        record(tmp_path, "sinesweep", {"axis": a, "bands": [band], "amplitude": size})
        for a, size in (("theta_x", 0.002), ("theta_y", 0.002), ("z", 0.01))
    ]
    found = identify(*paths)
    assert found.method == "stepped sine" and [p.dof for p in found.model.inputs] == list(MODES)
    assert_true_modes(found, [m[0] for m in SORTED], [m[1] for m in SORTED])
    response = found.model.linear().frequency_response(np.array([1.0]))[0]
    truth = bench_model().linear().frequency_response(np.array([1.0]))[0]
    np.testing.assert_allclose(response, truth, rtol=1e-3, atol=1e-12)
    assert parse_model(dump_model(found.model), "round trip") == found.model


def test_multisines_give_all_axes_at_once_with_noise_and_held_out_error(tmp_path):
    settings = {"period_s": 1.0, "start_hz": 2.0, "stop_hz": 100.0, "realisations": 2, "transient_periods": 3}
    found = identify(record(tmp_path, "multisine", settings), modes=3)
    assert found.method == "periodic, zero-order hold"
    assert_true_modes(found, [m[0] for m in SORTED], [m[1] for m in SORTED])
    assert 0.0 < found.noise < 1e-2
    assert len(found.held_out) == 3 and all(h.total < 0.01 for h in found.held_out)
    # the measured response against the bench's own model, behind its hold: complex Gaussian errors, so that beyond five
    # standard deviations of the magnitude there is 1 line in 10^6; a standard deviation from one spare realisation
    # of a few periods is itself uncertain by some ten per cent, hence seven
    assert {(c.output, c.input) for c in found.response} == {(o, i) for o in OUTPUTS for i in INPUTS}
    model = bench_model().linear()
    for curve in found.response:
        k, j = OUTPUTS.index(curve.output), INPUTS.index(curve.input)
        if k == j:
            truth = np.abs(model.frequency_response(curve.frequency_hz, hold_rate_hz=1e4)[:, k, j])
            assert np.all(np.abs(curve.magnitude - truth) < 7 * curve.noise_std + 1e-4 * truth)
            assert np.all(curve.noise_std < 0.1 * curve.magnitude)


def test_periods_of_one_axis_are_enough_where_the_other_inputs_rest(tmp_path):
    """One realisation separates one input, though the bench has three."""
    settings = {"period_s": 1.0, "start_hz": 2.0, "stop_hz": 500.0, "realisations": 1, "transient_periods": 1}
    path = record(tmp_path, "multisine", {**settings, "axes": ["theta_x"]})
    found = identify(path, modes=1)
    assert found.method.startswith("periodic")
    (mode,) = found.modes
    assert abs(mode["frequency_hz"] - MODES["theta_x"][0]) < 5 * mode["frequency_std_hz"] + 1e-5 * MODES["theta_x"][0]
    assert [port.name for port in found.model.inputs] == list(INPUTS)


def test_measured_response_is_written_once_as_a_table(tmp_path):
    settings = {"period_s": 1.0, "start_hz": 2.0, "stop_hz": 100.0, "realisations": 2, "transient_periods": 3}
    found, path = identify(record(tmp_path, "multisine", settings), modes=3), tmp_path / "response.csv"
    save_curves(found.response, path)
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(c.frequency_hz.size for c in found.response)
    assert float(rows[0]["magnitude"]) == found.response[0].magnitude[0]
    with pytest.raises(ConfigError, match="exists"):
        save_curves(found.response, path)
    with pytest.raises(ConfigError, match="no response by frequency"):
        save_curves((), tmp_path / "none.csv")


def test_a_free_run_gives_its_axis_from_rest(tmp_path):
    band_limited = {"axes": ["theta_x"], "steps_s": 0.5, "noise_s": 0.1, "held_out_s": 0.1}
    path = record(tmp_path, "freerun", band_limited)
    alone = tmp_path / "alone.h5"
    signals = (Signal("u", "N m", "input", "theta_x", 1e4), Signal("y", "rad", "output", "theta_x", 1e4))
    with read_run(path) as run, LogWriter.create(alone, signals, test="alone", bench={"kind": "file"}) as log:
        for segment in run.segments[:1]:
            with log.segment(segment.label):
                part = segment.start, segment.stop
                log.append({"u": run.read("command_theta_x", *part), "y": run.read("theta_x", *part)})
    found = identify(alone, modes=1)
    assert found.method == "free"
    assert_true_modes(found, [29.6], [4.7])


def test_distortion_is_told_from_noise(tmp_path):
    # at 2 mrad 4 % of the spring at 11.16 N m/rad: bent, but far from the jumps of a strongly nonlinear resonance
    cubic = EffectEntry(effect="cubic-stiffness", where="theta_x", parameters={"stiffness": 1e5})
    settings = {"start_hz": 2.0, "stop_hz": 100.0, "realisations": 3, "transient_periods": 3, "torque_rms_nm": 0.005}
    linear = identify(record(tmp_path, "multisine", settings), modes=3)
    bent = identify(record(tmp_path, "multisine", settings, (*NOISE, cubic)), modes=3)
    assert bent.distortion > 10 * linear.distortion and bent.distortion > 10 * bent.noise


@pytest.mark.parametrize("case", ["none", "held-out only", "same axis twice", "other channels", "other rate"])
def test_what_cannot_be_identified_is_refused(tmp_path, case):
    band = {"start_hz": 10.0, "stop_hz": 50.0, "step_hz": 10.0, "settle_s": 0.1}
    paths = {
        "none": [],
        "held-out only": [record(tmp_path, "multisine", {"period_s": 0.1, "start_hz": 20.0})],
        "same axis twice": [record(tmp_path, "sinesweep", {"bands": [band]}) for _ in range(2)],
        "other channels": [
            record(tmp_path, "freerun", {"steps_s": 0.3, "noise_s": 0.1, "held_out_s": 0.1}),
            record(tmp_path, "theodolite", {"x_rad": [0.0], "y_rad": [0.0]}),
        ],
        "other rate": [imported(tmp_path, 0.0)[0], imported(tmp_path, 0.0, rate_hz=5_000.0)[0]],
    }[case]
    says = {
        "none": "no run",
        "held-out only": "no segment remains",
        "same axis twice": "one sweep per axis",
        "other channels": "has the (in|out)puts .* has .*identify them apart",
        "other rate": "has 5000 Hz, .* has 10000 Hz; identify them apart",
    }[case]
    with pytest.raises(DataError, match=says):
        identify(*paths, only="held-out" if case == "held-out only" else "")


def test_what_has_no_effect_is_refused_or_said(tmp_path):
    band = {"start_hz": 10.0, "stop_hz": 50.0, "step_hz": 10.0, "settle_s": 0.1}
    sweep = record(tmp_path, "sinesweep", {"bands": [band]})
    for options, name in (({"only": "20 Hz"}, "--only"), ({"equal_weights": True}, "--equal-weights")):
        with pytest.raises(ConfigError, match=f"{name} .* has no effect on stepped sines"):
            identify(sweep, **options)
    free, _ = imported(tmp_path, 0.0)
    assert any("equal weights have no effect" in said for said in identify(free, modes=1, equal_weights=True).remarks)
    assert not any("equal weights" in said for said in identify(free, modes=1).remarks)


def imported(tmp_path, offset, *, period=None, rate_hz=10_000.0):
    """A log of another bench: one mode at 29.6 Hz under noise or a multisine, read from a zero of its own."""
    rng = np.random.default_rng(4)
    u = rng.standard_normal(6000) if period is None else np.tile(rng.standard_normal(period), 6000 // period)
    plant = discretise(bench_model().linear(), 10_000.0)
    y = simulate_linear(plant, np.stack([1e-2 * u, 0 * u, 0 * u], axis=1))[:, 0]
    values = {"u": 1e-2 * u, "y": y + offset + 1e-3 * np.std(y) * rng.standard_normal(6000)}
    channels = [Signal("u", "N m", "input", "tilt", rate_hz), Signal("y", "rad", "output", "tilt", rate_hz)]
    path = tmp_path / f"imported-{offset}-{period}-{rate_hz:g}.h5"
    with LogWriter.create(path, channels, test="t", bench={"kind": "imported", "name": "other"}) as log:
        settings = {} if period is None else {"period_samples": period, "transient_periods": 2}
        for label, rows in (("fit", slice(0, 4000)), ("held-out", slice(4000, 6000))):
            with log.segment(label, settings):
                log.append({k: v[rows] for k, v in values.items()})
    return path, np.std(y)


@pytest.mark.parametrize("period", [None, 1000])
def test_the_zero_of_a_foreign_bench_is_written_as_an_offset(tmp_path, period):
    path, size = imported(tmp_path, 0.5, period=period)
    found = identify(path, modes=1)
    (entry,) = found.model.effects
    assert (entry.effect, entry.where) == ("sensor-offset", "tilt")
    # the offset is half a radian, the motion about 1e-4: it must come back far within that
    assert abs(entry.parameters["offset"].value - 0.5) < 0.1 * size
    assert parse_model(dump_model(found.model), "round trip") == found.model


def from_rest(tmp_path, hardening, before=0):
    """Four periods of a multisine on a light mode of 12 Hz, after `before` periods, and the noise over the output."""
    rng = np.random.default_rng(3)
    rate_hz, period, fine = 500.0, 500, 20
    at = np.arange(period) / period
    one = 15.0 * sum(np.cos(2 * np.pi * (k * at + rng.uniform())) for k in range(2, 60))
    omega, decay, angle, speed, angles = 2 * np.pi * 12.0, 1.1, 0.0, 0.0, []
    step_s = 1.0 / (rate_hz * fine)
    for u in np.tile(one, before + 4):
        angles.append(angle)
        for _ in range(fine):  # symplectic Euler: its steps are short against the period of the mode
            speed += step_s * (u - 2.0 * decay * speed - omega**2 * (angle + hardening * angle**3))
            angle += step_s * speed
    y = np.array(angles[before * period :])
    noise = 1e-3 * np.std(y[-period:])
    channels = [Signal("u", "N m", "input", "tilt", rate_hz), Signal("y", "rad", "output", "tilt", rate_hz)]
    path = tmp_path / f"from-rest-{hardening}-{before}.h5"
    with LogWriter.create(path, channels, test="t", bench={"kind": "imported", "name": "other"}) as log:
        with log.segment("fit", {"period_samples": period}):
            log.append({"u": np.tile(one, 4), "y": y + noise * rng.standard_normal(y.size)})
    return path, 1e-3


@pytest.mark.parametrize("hardening", [0.0, 4.0])
def test_noise_beside_a_start_that_rings_on_is_a_bound(tmp_path, hardening):
    path, noise = from_rest(tmp_path, hardening)
    found = identify(path, modes=1)
    assert found.noise_is_bound and found.noise > 0.8 * noise
    assert f"at most {100.0 * found.noise:.3f} % of the output" in dict(facts(found))["noise"]
    if hardening == 0.0:  # a linear swing is taken out as a whole
        assert found.noise == pytest.approx(noise, rel=0.2)


def test_noise_of_a_steady_record_is_no_bound(tmp_path):
    path, noise = from_rest(tmp_path, 0.0, before=16)
    found = identify(path, modes=1)
    assert not found.noise_is_bound and found.noise == pytest.approx(noise, rel=0.2)
    assert "at most" not in dict(facts(found))["noise"]


def test_the_own_bench_has_no_zero_of_its_own(tmp_path):
    settings = {"period_s": 1.0, "start_hz": 2.0, "stop_hz": 100.0, "realisations": 1, "transient_periods": 1}
    assert identify(record(tmp_path, "multisine", settings), modes=3).model.effects == []
