"""A proposed map is a map: it imports as it stands, and what nobody can know is marked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from campaigns.importing import import_run
from campaigns.importing.guess import guess
from campaigns.log import read_run
from sim_backend.errors import DataError


def proposed(tmp_path: Path, *files: Path) -> tuple[str, str]:
    found = guess(files, tmp_path)
    (tmp_path / "map.toml").write_text(found.text, encoding="utf-8")
    return found.text, "\n".join(found.said)


def table(tmp_path: Path, head: str, columns: list[np.ndarray], name: str = "a.csv", separator: str = ";") -> Path:
    rows = "\n".join(separator.join(repr(float(v)) for v in row) for row in np.stack(columns, axis=1))
    (tmp_path / name).write_text(f"{head}\n{rows}\n", encoding="utf-8")
    return tmp_path / name


def test_names_units_clock_period_and_roles(tmp_path):
    period = np.random.default_rng(2).standard_normal(200)
    u, t_ms = np.tile(period, 5), np.arange(1000) * 0.5
    path = table(tmp_path, "time (ms);drive [mN m];angle [urad];setpoint [urad]", [t_ms, u, 3.0 * u, u])
    text, said = proposed(tmp_path, path)
    assert "# DOUBTFUL" not in text and "period = 200" in text and "2000 Hz" in said
    made = import_run(tmp_path / "map.toml", tmp_path / "a.h5")
    assert made.sample_rate_hz == pytest.approx(2000.0)
    assert {c.name: (c.unit, c.role, c.dof) for c in made.channels} == {
        "drive": ("N m", "input", "x"),
        "angle": ("rad", "output", "x"),
        "setpoint": ("rad", "reference", "x"),
    }
    with read_run(tmp_path / "a.h5") as run:
        np.testing.assert_allclose(run.read("angle"), 3e-6 * u, rtol=1e-14)
        assert run.segments[0].settings["period_samples"] == 200


def test_what_nobody_can_know_is_marked(tmp_path):
    rng = np.random.default_rng(1)
    path = table(tmp_path, "a;b", [rng.standard_normal(300), rng.standard_normal(300)])
    text, said = proposed(tmp_path, path)
    lines = [line for line in text.splitlines() if "DOUBTFUL" in line]
    assert [line.split()[0] for line in lines[1:]] == ["sample_rate_hz", "unit", "role", "unit"]
    assert "nothing says which column is the input" in said
    assert "period" not in text
    import_run(tmp_path / "map.toml", tmp_path / "a.h5")


def test_several_axes_get_their_degrees_of_freedom_and_several_files_are_parts(tmp_path):
    rng = np.random.default_rng(1)
    for name in ("first.npz", "second.npz"):
        x = rng.standard_normal((4, 100))
        np.savez(tmp_path / name, t=np.arange(100) * 1e-3, torque_x=x[0], torque_y=x[1], angle_x=x[2], angle_y=x[3])
    proposed(tmp_path, tmp_path / "first.npz", tmp_path / "second.npz")
    made = import_run(tmp_path / "map.toml", tmp_path / "a.h5")
    assert [(c.name, c.role, c.dof) for c in made.channels] == [
        ("torque_x", "input", "x"),
        ("torque_y", "input", "y"),
        ("angle_x", "output", "x"),
        ("angle_y", "output", "y"),
    ]
    assert [s.label for s in made.segments] == ["first", "second"]


def test_a_column_that_cannot_be_read_is_left_out_and_said(tmp_path):
    (tmp_path / "a.csv").write_text("u,y,note\n0.5,1.5,\n0.75,2.5,warm\n0.25,3.5,\n", encoding="utf-8")
    text, said = proposed(tmp_path, tmp_path / "a.csv")
    assert "note" not in text and "'note' is left out" in said
    (tmp_path / "c.csv").write_text(",u,y\n0,0.5,1.5\n1,0.25,2.5\n2,0.75,1.0\n", encoding="utf-8")
    text, said = proposed(tmp_path, tmp_path / "c.csv")
    assert text.count('select = "u"') == 1 and "has no name of its own" in said
    with pytest.raises(DataError, match="two are needed"):
        guess([table(tmp_path, "temp1;pressure", [np.arange(9.0), np.arange(9.0) ** 2], "d.csv")], tmp_path)
    with pytest.raises(DataError, match=r"1 column\(s\) beside its clock"):
        guess([table(tmp_path, "t;u", [np.arange(9.0), np.arange(9.0) ** 2], "b.csv")], tmp_path)
