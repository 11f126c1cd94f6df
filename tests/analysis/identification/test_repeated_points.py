"""Tables with several rows per frequency: levels are told apart, repeats averaged, and nothing is mixed unsaid."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.response.lines import load_lines
from analysis.identification.from_table import identify_table
from analysis.identification.repeated_points import averaged
from analysis.identification.response_table import read_table
from sim_backend.errors import DataError
from tests.analysis.identification.test_from_table import F, response, written

LEVELS = (0.1, 1.0)
SOFTER = 0.9
"""Factor of the first mode's frequency at the larger amplitude."""


def two_levels(path, column, *, interleaved=True):
    """A table of two amplitudes whose responses differ, in a column of the given name."""
    size = np.repeat(LEVELS, F.size)
    h = np.concatenate([response(F), response(F, stiffer=SOFTER)])
    order = np.argsort(np.tile(F, 2), kind="stable") if interleaved else np.arange(2 * F.size)
    columns = [np.tile(F, 2)[order], size[order], np.abs(h)[order], np.degrees(np.angle(h))[order]]
    return written(path, ["frequency (Hz)", column, "magnitude (m/N)", "phase (deg)"], columns)


@pytest.mark.parametrize("name", ["amplitude (V)", "Amplitude", "ampl_V", "amplitude_v", "input amplitude (N)"])
@pytest.mark.parametrize("interleaved", [False, True])
def test_an_amplitude_beside_a_magnitude_is_the_level(tmp_path, name, interleaved):
    path = two_levels(tmp_path / "h.csv", name, interleaved=interleaved)
    for level, stiffer in zip(LEVELS, (1.0, SOFTER), strict=True):
        found = identify_table(path, modes=2, level=level)
        assert found.modes[0]["frequency_hz"] == pytest.approx(31.0 * stiffer, abs=0.02)
    assert identify_table(path, modes=2).modes[0]["frequency_hz"] == pytest.approx(31.0, abs=0.02)
    model = identify_table(path, modes=2).model
    lines = load_lines(path, model)
    assert np.unique(lines.level).tolist() == list(LEVELS) and np.all(lines.count == 1.0)


@pytest.mark.parametrize("heads", [["amplitude (m/N)", "phase (deg)"], ["Re", "Im", "amplitude"]])
def test_an_amplitude_that_may_be_the_magnitude_is_asked_about(tmp_path, heads):
    h = response(F)
    columns = [np.abs(h), np.degrees(np.angle(h)), np.abs(h)][: len(heads)]
    path = written(tmp_path / "h.csv", ["f (Hz)", *heads], [F, *columns])
    with pytest.raises(DataError, match="'amplitude.*' may be the magnitude of the response or the level"):
        read_table(path)


def test_an_amplitude_ratio_is_a_magnitude(tmp_path):
    h = response(F)
    heads = ["f (Hz)", "amplitude ratio (dB)", "phase (deg)"]
    path = written(tmp_path / "h.csv", heads, [F, 20.0 * np.log10(np.abs(h)), np.degrees(np.angle(h))])
    np.testing.assert_allclose(read_table(path).response, h, rtol=1e-6)


@pytest.mark.parametrize("name", ["voltage (V)", "run"])
def test_an_unknown_column_that_separates_curves_is_asked_about(tmp_path, name):
    path = two_levels(tmp_path / "h.csv", name)
    with pytest.raises(DataError, match=r"different values of .* \(0.1, 1\).* name it 'level \(unit\)'"):
        identify_table(path)
    # the same in the diagnosis; the model is that of one level alone
    alone = identify_table(two_levels(tmp_path / "level.csv", "level (V)"), modes=2).model
    with pytest.raises(DataError, match="different values of"):
        load_lines(path, alone)


def test_repeats_are_averaged_alike_in_identification_and_diagnosis(tmp_path):
    rng = np.random.default_rng(5)
    error = 0.02 * (rng.standard_normal((3, F.size)) + 1j * rng.standard_normal((3, F.size)))
    h = (response(F) * (1.0 + error)).ravel()
    columns = [np.tile(F, 3), h.real, h.imag, np.arange(3.0 * F.size)]
    path = written(tmp_path / "h.csv", ["f (Hz)", "Re", "Im", "time"], columns)
    mean = averaged(read_table(path), path)
    np.testing.assert_allclose(mean.table.response, h.reshape(3, -1).mean(axis=0), rtol=1e-6)
    assert np.all(mean.count == 3.0)
    found = identify_table(path)
    curve = found.response[0]
    np.testing.assert_allclose(curve.magnitude, np.abs(mean.table.response))
    lines = load_lines(path, found.model)
    np.testing.assert_array_equal(lines.response, mean.table.response)
    (told,) = [remark for remark in found.remarks if "several times" in remark]
    assert f"{F.size} of {F.size} points" in told and told in lines.remarks


def test_a_table_without_repeats_is_left_as_it_is(tmp_path):
    h = response(F)
    path = written(tmp_path / "h.csv", ["f (Hz)", "Re", "Im"], [F, h.real, h.imag])
    one = averaged(read_table(path), path)
    assert one.table.remarks == () and one.scatter.shape == (0, 3)
    np.testing.assert_array_equal(one.table.response, read_table(path).response)
