"""`mccd identify` says what it knows of a record before the fit, and its numbers with deviations and on a page."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from analysis.identification import identify
from analysis.identification.bode import bode, measured_curves
from analysis.identification.from_table import identify_table
from mccdcli.main import main
from sim_backend.errors import DataError
from tests import headless
from tests.analysis.identification.test_from_table import F, response, written
from tests.analysis.identification.two_mode_bench import play, write


@pytest.fixture
def table(tmp_path: Path) -> Path:
    h = response(F) * (1.0 + 1e-3 * np.random.default_rng(1).standard_normal(F.size))
    return written(
        tmp_path / "h.csv", ["f (Hz)", "mag (rad/N m)", "phase (deg)"], [F, np.abs(h), np.degrees(np.angle(h))]
    )


def test_a_segment_at_rest_is_named_before_the_fit(tmp_path, monkeypatch, capsys):
    u, y = play(0.0, 1, 2000)
    y[1500:] = y[1499]
    path = write(tmp_path / "run.h5", u, y, [("fit", 0, 1500), ("still", 1500, 2000)])

    def fails(*_: object, **__: object) -> None:
        raise DataError("the fit has begun")

    monkeypatch.setattr(identify, "_from_records", fails)
    assert main(["identify", "--log", str(path), "-o", str(tmp_path / "m.toml")]) != 0
    said = capsys.readouterr().err
    assert 'in all of "still"' in said and "the segment is left out" in said
    assert said.index("is left out") < said.index("the fit has begun")


SWEPT = "goes with sweeps, and {} plays none; leave out one of the two"
IDLE = {
    "bench": (["--log", "{log}", "--bench", "sim"], f"--bench {SWEPT.format('--log')}"),
    "axis": (["--log", "{log}", "--axis", "theta_x"], f"--axis {SWEPT.format('--log')}"),
    "logs": (["--log", "{log}", "--logs", "folder"], f"--logs {SWEPT.format('--log')}"),
    "set": (["--frf", "{table}", "--set", "amplitude=1"], f"--set {SWEPT.format('--frf')}"),
    "seed": (["--frf", "{table}", "--seed", "0"], f"--seed {SWEPT.format('--frf')}"),
    "note": (["--log", "{log}", "--note", "mine"], f"--note {SWEPT.format('--log')}"),
    "dry run of logs": (["--log", "{log}", "--dry-run"], f"--dry-run {SWEPT.format('--log')}"),
    "dry run of a table": (["--frf", "{table}", "--dry-run"], f"--dry-run {SWEPT.format('--frf')}"),
    "rate of logs": (["--log", "{log}", "--rate", "1000"], "--rate goes with --frf"),
    "level of sweeps": (["--level", "1"], "--level goes with --frf"),
    "a part of sweeps": (["--only", "x"], "--only goes with --log"),
    "weights of a table": (["--frf", "{table}", "--equal-weights"], "--equal-weights goes with --log"),
    "logs and a table": (["--frf", "{table}", "--log", "{log}"], "give logs or a frequency-response table, not both"),
    "a level that no column has": (["--frf", "{table}", "--level", "1"], "has no column of levels; leave out --level"),
    "the axis of every sweep": (["--set", "axis=theta_y"], "every axis has a sweep of its own; use --axis"),
}


@pytest.mark.parametrize("case", IDLE)
def test_an_option_without_effect_is_refused_before_anything_is_written(case, tmp_path, table, monkeypatch, capsys):
    arguments, said = IDLE[case]
    monkeypatch.chdir(tmp_path)
    files = {"log": write(tmp_path / "run.h5", *play(0.0, 1, 200), [("fit", 0, 200)]), "table": table}
    before = sorted(tmp_path.iterdir())
    assert main(["identify", *(word.format(**files) for word in arguments)]) == 2
    assert said in " ".join(capsys.readouterr().err.split()) and sorted(tmp_path.iterdir()) == before


def test_what_settings_say_of_sweeps_is_no_reason_to_refuse_a_log_but_a_dry_run_is(
    table, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MCCD_BENCH", "sim:design")
    monkeypatch.setenv("MCCD_IDENTIFY_EQUAL_WEIGHTS", "true")
    assert main(["identify", "--frf", str(table), "--modes", "2"]) == 0
    assert main(["identify", "--out", "other.toml"]) == 2
    assert "--only and --equal-weights go with --log" in capsys.readouterr().err
    monkeypatch.setenv("MCCD_IDENTIFY_DRY_RUN", "true")
    assert main(["identify", "--frf", str(table), "--out", "other.toml"]) == 2
    assert "--dry-run counts sweeps" in capsys.readouterr().err and not (tmp_path / "other.toml").exists()


def test_every_number_has_its_deviation_and_every_mode_its_axis(tmp_path, table, capsys):
    args = ["identify", "--frf", str(table), "--modes", "2"]
    assert main([*args, "-o", str(tmp_path / "text.toml")]) == 0
    text = capsys.readouterr().out
    heads, *rows = text.splitlines()[:3]
    assert re.split(r"\s{2,}", heads) == ["axis", "frequency, Hz", "decay rate, s⁻¹", "damping ratio ζ"]
    assert all(row.startswith("x ") and row.count(" ± ") == 3 for row in rows)
    assert re.search(r"static gain input → output +0\.00144\d+ ± \S+ rad per N m", text)
    assert main([*args, "-o", str(tmp_path / "json.toml"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["identification"]
    assert found["axes"] == ["x", "x"]
    (gain,) = found["gains"]
    exact = 40.0 / (2.0 * np.pi * 31.0) ** 2 + 300.0 / (2.0 * np.pi * 140.0) ** 2
    assert abs(gain["value"] - exact) < 5.0 * gain["std"] and gain["std"] < 1e-3 * exact


def test_the_model_of_a_table_is_drawn_without_a_hold(table):
    """A hold would add 18 degrees at the highest frequency of the table."""
    found = identify_table(table, modes=2)
    (curve,) = measured_curves(found, [])
    _, phase = bode(found.model, [curve], continuous=found.of_a_table).axes
    f, drawn = (np.asarray(part) for part in phase.lines[1].get_data())
    top = f > 300.0
    apart = drawn[top] - np.interp(f[top], curve.frequency_hz, np.degrees(curve.phase_rad))
    assert np.abs((apart + 180.0) % 360.0 - 180.0).max() < 1.0


def test_a_page_replaces_a_page_and_nothing_else(tmp_path, table, capsys):
    page, args = tmp_path / "m.html", ["identify", "--frf", str(table), "--modes", "2", "--force"]
    for _ in range(2):
        assert main([*args, "-o", str(tmp_path / "m.toml"), "--plot", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "<svg" in text and "static gain input → output" in text and text.count("<tr>") >= 4
    page.write_text("mine")
    assert main([*args, "-o", str(tmp_path / "m.toml"), "--plot", str(page)]) == 2
    assert "m.html exists and is not a page" in capsys.readouterr().err and page.read_text() == "mine"


@pytest.mark.skipif(headless.installed() is None, reason="no Chromium is installed; MCCD_BROWSER may name one")
def test_the_page_asks_for_nothing_fits_a_telephone_and_is_readable(tmp_path, table):
    page = tmp_path / "m.html"
    # one mode for a plant of two, so that there is a remark
    assert (
        main(["identify", "--frf", str(table), "--modes", "1", "-o", str(tmp_path / "m.toml"), "--plot", str(page)])
        == 0
    )
    with headless.browser() as tab:
        headless.check_desk_and_phone(tab, page)
        assert tab.run("document.querySelectorAll('figure svg').length") == 1
        assert "the model misses the response" in tab.run("document.querySelector('main ul').textContent")
