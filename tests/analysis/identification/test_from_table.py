"""Tables of frequency response as laboratories write them give the modes that made them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.identification.from_table import identify_table
from analysis.identification.response_table import read_table
from sim_backend.errors import ConfigError, DataError

F = np.concatenate([np.arange(5.0, 60.0, 0.5), np.arange(60.0, 400.0, 2.0)])


def response(f: np.ndarray, stiffer: float = 1.0) -> np.ndarray:
    s = 2j * np.pi * f
    out = np.zeros(f.size, dtype=complex)
    for hz, zeta, gain in ((31.0 * stiffer, 0.02, 40.0), (140.0, 0.01, 300.0)):
        omega = 2 * np.pi * hz
        out += gain / (s**2 + 2 * zeta * omega * s + omega**2)
    return out


def written(path: Path, heads: list[str], columns: list[np.ndarray], separator: str = ",") -> Path:
    rows = [separator.join(f"{v:.9g}" for v in row) for row in np.stack(columns, axis=1)]
    path.write_text("\n".join([separator.join(heads), *rows]) + "\n", encoding="utf-8")
    return path


FORMS = {
    "magnitude and degrees": (
        ["freq (Hz)", "mag (m/N)", "phase (deg)"],
        lambda h: [np.abs(h), np.degrees(np.angle(h))],
    ),
    "decibels and rad": (
        ["f [Hz]", "magnitude [dB]", "phase [rad]"],
        lambda h: [20 * np.log10(np.abs(h)), np.angle(h)],
    ),
    "unwrapped degrees": (
        ["freq", "gain", "phase"],
        lambda h: [np.abs(h), np.degrees(np.unwrap(np.angle(h))) - 720.0],
    ),
    "real and imaginary": (["frequency (Hz)", "Re", "Im"], lambda h: [h.real, h.imag]),
    "long names": (["frequency", "real", "imag"], lambda h: [h.real, h.imag]),
    "units behind a line": (["freq_hz", "mag_dB", "phase_rad"], lambda h: [20 * np.log10(np.abs(h)), np.angle(h)]),
    "millimetres": (["f (Hz)", "mag (mm/N)", "phase (rad)"], lambda h: [1e3 * np.abs(h), np.angle(h)]),
}


@pytest.mark.parametrize("form", FORMS)
def test_modes_are_found_in_any_form(tmp_path, form):
    heads, columns = FORMS[form]
    h = response(F) * (1.0 + 1e-3 * np.random.default_rng(1).standard_normal(F.size))
    path = written(tmp_path / "h.csv", heads, [F, *columns(h)])
    np.testing.assert_allclose(read_table(path).response, h, rtol=1e-6)
    found = identify_table(path)
    assert [round(mode["frequency_hz"], 1) for mode in found.modes] == [31.0, 140.0]
    zeta = [mode["decay_rate_1_s"] / (2 * np.pi * mode["frequency_hz"]) for mode in found.modes]
    np.testing.assert_allclose(zeta, [0.02, 0.01], rtol=0.02)
    assert found.model.sample_rate_hz == pytest.approx(10.0 * F[-1])


def test_levels_are_told_apart(tmp_path):
    f, level = np.tile(F, 2), np.repeat([0.5, 2.0], F.size)
    h = np.concatenate([response(F), response(F, stiffer=1.1)])
    heads = ["level", "frequency (Hz)", "mag (rad/N m)", "phase (deg)"]
    path = written(tmp_path / "h.csv", heads, [level, f, np.abs(h), np.degrees(np.angle(h))])
    assert identify_table(path, modes=2).modes[0]["frequency_hz"] == pytest.approx(31.0, abs=0.02)
    assert identify_table(path, modes=2, level=2.0).modes[0]["frequency_hz"] == pytest.approx(34.1, abs=0.02)
    assert [p.unit for p in (*identify_table(path).model.inputs, *identify_table(path).model.outputs)] == ["N m", "rad"]
    with pytest.raises(ConfigError, match="no level 3: it has 0.5, 2"):
        identify_table(path, level=3.0)


@pytest.mark.parametrize(
    ("heads", "said"),
    [
        (["x", "mag", "phase (deg)"], "no column of frequency"),
        (["f (mm)", "mag", "phase (deg)"], "frequency is in 'mm'"),
        (["f (Hz)", "mag", "phase"], "degrees or rad"),
        (["f (Hz)", "mag", "other"], "magnitude and phase, or of real and imaginary"),
        (["omega", "mag", "phase (deg)"], "frequency is in 'nothing that is said'"),
        (["f (Hz)", "mag (furlong/N)", "phase (deg)"], "the response is in 'furlong/N'"),
        (["f (Hz)", "mag x", "mag y"], "two columns of magnitude"),
    ],
)
def test_what_is_not_told_is_asked_for(tmp_path, heads, said):
    path = written(tmp_path / "h.csv", heads, [F, np.ones(F.size), np.linspace(0.0, -3.0, F.size)])
    with pytest.raises(DataError, match=said):
        read_table(path)


def test_rad_per_s_and_khz_are_frequencies(tmp_path):
    h = response(F)
    for head, factor in (("omega (rad/s)", 2 * np.pi), ("freq_khz", 1e-3)):
        path = written(tmp_path / "h.csv", [head, "Re", "Im"], [F * factor, h.real, h.imag])
        np.testing.assert_allclose(read_table(path).frequency_hz, F, rtol=1e-6)
    with pytest.raises(ConfigError, match="rate is 20 Hz"):
        identify_table(path, rate_hz=20.0)


@pytest.mark.parametrize(("column", "value"), [(0, 1e70), (1, 1e200), (1, 1e-200)])
def test_a_number_whose_square_is_none_is_refused(tmp_path, column, value):
    columns = [F.copy(), np.ones(F.size), np.linspace(0.0, -3.0, F.size)]
    columns[column][4] = value
    path = written(tmp_path / "h.csv", ["f (Hz)", "mag", "phase (rad)"], columns)
    with pytest.raises(DataError, match=f"row 5 has a .* of {value:.3g} in SI units".replace("+", r"\+")):
        read_table(path)
