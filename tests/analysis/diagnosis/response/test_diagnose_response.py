"""What frequency-response tables show of a model: named where it can be told, tied or unknown where it cannot."""

from __future__ import annotations

import re

import numpy as np
import pytest
import scipy

from analysis.diagnosis.response.diagnose import diagnose_response
from analysis.diagnosis.response.lines import load_lines
from analysis.diagnosis.response.page import bode_figures
from tests.analysis.diagnosis.response.tables import MODES, F, modelled, noisy, nominal, response, written

S = 2j * np.pi * F
EXTRA = 0.05 * 40.0 / (S**2 + 2.0 * 0.01 * (2 * np.pi * 80.0) * S + (2 * np.pi * 80.0) ** 2)


def diagnosed(path, f, h, *, held=False, **more):
    model = nominal()
    table = written(path / "h.csv", f, h, **more)
    return diagnose_response(load_lines(table, model), model, table, held=held)[0]


def test_points_of_both_models_differ_in_mark_as_well_as_in_colour(tmp_path):
    h, model = noisy(response(), 1), nominal()
    table = written(tmp_path / "h.csv", F, h, std=2e-3 * np.abs(h))
    _, drawn = diagnose_response(load_lines(table, model), model, table)
    (figure,) = bode_figures(drawn, model)
    below = [line for line in figure.canvas.axes[2].lines if line.get_linestyle() == "None"]
    assert [line.get_label() for line in below] == ["noise floor", "adjusted", "extended"]
    assert len({line.get_marker() for line in below}) == len({line.get_color() for line in below}) == 3


@pytest.mark.parametrize("told", [True, False], ids=["deviations", "none"])
def test_a_right_model_is_consistent(tmp_path, told):
    h = noisy(response(), 1)
    found = diagnosed(tmp_path, F, h, **({"std": 2e-3 * np.abs(h)} if told else {}))
    assert found.verdict == "consistent", found.sentence
    assert found.gain is not None and found.gain.noise_floor == pytest.approx(2.8e-3, rel=0.3)


NAMED = {
    "delay": (response() * np.exp(-S * 2e-4), "delay", {"seconds": 2e-4}),
    "lag": (response() / (1.0 + S * 3e-4), "amplifier-lag", {"time_constant_s": 3e-4}),
    # the residue is relative to that of the dominant mode, which is the first
    "mode": (
        response() + EXTRA,
        "extra-resonance",
        {"participation": 0.05, "frequency_hz": 80.0, "damping_ratio": 0.01},
    ),
}


@pytest.mark.parametrize("case", NAMED)
def test_a_linear_cause_is_named_with_its_parameters(tmp_path, case):
    h, effect, truth = NAMED[case]
    found = diagnosed(tmp_path, F, noisy(h, 2), std=2e-3 * np.abs(h))
    assert found.verdict == "named", found.notes
    (cause,) = found.causes
    assert cause.effect == effect and cause.probability < 1.0
    for name, value in truth.items():
        estimate = cause.parameters[name]
        assert abs(estimate.value - value) < 3.0 * estimate.std, name
    assert found.gain is not None and found.gain.rms_after < 2.0 * found.gain.noise_floor < found.gain.rms_before


def test_a_cause_is_named_where_nothing_tells_the_noise(tmp_path):
    found = diagnosed(tmp_path, F, noisy(response() * np.exp(-S * 2e-4), 3))
    (cause,) = found.causes
    estimate = cause.parameters["seconds"]
    assert (found.verdict, cause.effect) == ("named", "delay")
    assert abs(estimate.value - 2e-4) < 3.0 * estimate.std


def test_a_gain_is_that_of_drive_or_sensor_and_no_table_tells_which(tmp_path):
    h = 1.4 * response()
    found = diagnosed(tmp_path, F, noisy(h, 4), std=2e-3 * np.abs(h))
    assert found.verdict == "ambiguous" and found.causes == ()
    assert {"actuator-gain", "sensor-gain"} <= set(found.ambiguous[0])
    # a factor in every residue: one error is in both modes alike, numbers of their own are not
    gain = next(effect for effect in found.effects if hasattr(effect, "relative"))
    assert gain.relative == pytest.approx(0.4, abs=0.15)


def levels(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    level = {"level (N m)": np.repeat([0.1, 1.0], F.size)}
    return np.tile(F, 2), np.concatenate([noisy(first, 5), noisy(last, 6)]), level


def test_a_resonance_that_falls_with_the_level_is_described_and_not_named(tmp_path):
    f, h, level = levels(response(), response(softer=0.97))
    found = diagnosed(tmp_path, f, h, **level)
    assert found.verdict == "unknown" and found.causes == () and found.gain is None
    told = re.search(r"from 0.1 to 1 N m the resonance falls ([\d.]+) % \(from ([\d.]+) to", found.sentence)
    assert told and "softens" in found.sentence, found.sentence
    assert [float(x) for x in told.groups()] == pytest.approx([3.0, 31.0], rel=0.05)
    assert found.evidence["level"][0].p_value < 1e-6
    assert found.linear.omega_rad_s[0] / (2 * np.pi) == pytest.approx(31.0, abs=0.05), "that of the lowest level"


def test_levels_that_are_alike_are_one_linear_response(tmp_path):
    f, h, level = levels(response(), response())
    found = diagnosed(tmp_path, f, h, **level)
    assert found.verdict == "consistent"
    assert found.evidence["level"][0].p_value > 1e-3


def test_what_no_linear_effect_of_the_library_makes_is_unknown(tmp_path):
    # two more modes beside each other, and a zero in the right half plane: more than may be added at once
    rough = response() * (1.0 + 0.2 * np.sin(9.0 * np.log(F)) * np.exp(1j * np.cos(7.0 * np.log(F))))
    found = diagnosed(tmp_path, F, noisy(rough, 7), std=2e-3 * np.abs(rough))
    assert found.verdict == "unknown" and found.causes == ()


@pytest.mark.parametrize("late_s", [0.0, 2e-4])
def test_coherence_tells_which_lines_are_worth_little(tmp_path, late_s):
    """Twenty averages of which a hum near 60 Hz spoils some lines two hundred times as much as the others."""
    relative = 2e-4 + 0.05 * np.exp(-((np.log(F / 60.0) / 0.15) ** 2))
    coherence = 1.0 / (1.0 + 2.0 * 20 * relative**2)
    rng = np.random.default_rng(8)
    spoilt = 1.0 + relative * (rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size))
    found = diagnosed(tmp_path, F, response() * np.exp(-S * late_s) * spoilt, coherence=coherence)
    assert found.verdict == ("named" if late_s else "consistent"), found.sentence
    for cause in found.causes:
        seconds = cause.parameters["seconds"]
        assert cause.effect == "delay"
        assert abs(seconds.value - late_s) < 3.0 * seconds.std
        # by the sound lines alone: all alike would tell it no better than 1e-6
        assert seconds.std < 2e-7


def held(f: np.ndarray, rate_hz: float) -> np.ndarray:
    """The response from commands to readings behind a hold, by the step response of each mode."""
    out = np.zeros(f.size, dtype=complex)
    for hz, zeta, residue in MODES:
        omega = 2.0 * np.pi * hz
        system = ([residue], [1.0, 2.0 * zeta * omega, omega**2])
        b, a, _ = scipy.signal.cont2discrete(system, 1.0 / rate_hz)
        out += scipy.signal.freqz(b[0], a, worN=f, fs=rate_hz)[1]
    return out


def test_a_table_of_commands_and_readings_is_held_or_half_a_sample_late(tmp_path):
    h = noisy(held(F, 5000.0), 9)
    std = 2e-3 * np.abs(h)
    assert diagnosed(tmp_path, F, h, held=True, std=std).verdict == "consistent"
    continuous = diagnosed(tmp_path, F, h, std=std)
    assert [cause.effect for cause in continuous.causes] == ["delay"]
    assert "--held" in " ".join(continuous.notes), continuous.notes


def test_of_two_drives_and_two_readings_the_late_drive_is_named(tmp_path):
    """Four responses, named by output and input; a delay of one drive is in both of its responses and in no other."""
    one = nominal().linear()
    shape, drive = np.array([[1.0, 0.6], [0.7, -1.0]]), np.array([[1.0, 0.5], [0.4, -1.0]])
    none = np.zeros((2, 2))
    both = one.with_(b=one.b * drive, b_direct=none, c=shape, c_rate=none, d=none, delay_s=np.zeros(2))
    model = modelled(both, "two axes", ("1", "2"))
    h = model.linear().frequency_response(F, None)
    h[:, :, 1] *= np.exp(-S * 2e-4)[:, None]
    rows = ["output,input,frequency_hz,magnitude,phase_rad,std,noise_std"]
    for o in range(2):
        for i in range(2):
            one_h = noisy(h[:, o, i], 10 + 2 * o + i)
            rows += [
                f"y{o + 1},u{i + 1},{f},{abs(value)},{np.angle(value)},{2e-3 * abs(value)},nan"
                for f, value in zip(F, one_h, strict=True)
            ]
    table = tmp_path / "h.csv"
    table.write_text("\n".join(rows) + "\n")
    found = diagnose_response(load_lines(table, model), model, table)[0]
    assert [(cause.effect, cause.where) for cause in found.causes] == [("delay", "x2")], found.sentence
