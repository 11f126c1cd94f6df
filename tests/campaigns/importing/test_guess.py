"""A proposed map is a map: it imports as it stands, and what nobody can know is marked."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from campaigns.importing import import_run
from campaigns.importing.guess import guess
from campaigns.log import read_run
from sim_backend.errors import DataError
from tests.campaigns.importing.test_formats import write_mat73

RNG = np.random.default_rng(8)
T, U, Y = np.arange(200) * 1e-3, RNG.standard_normal(200), RNG.standard_normal(200)


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


def test_the_segments_that_it_offers_are_whole_periods_once_they_are_uncommented(tmp_path):
    u = np.tile(np.random.default_rng(2).standard_normal(150), 7)
    path = table(tmp_path, "t [s];u [N];y [m]", [np.arange(1050) * 1e-3, u, np.roll(u, 3)])
    text, said = proposed(tmp_path, path)
    assert "nothing is held out" in said and "Nothing is held out" in text
    kept = text[: text.index("# [segments]")] + text[text.index("# [segments]") :].replace("# ", "")
    (tmp_path / "map.toml").write_text(kept, encoding="utf-8")
    import_run(tmp_path / "map.toml", tmp_path / "a.h5")
    with read_run(tmp_path / "a.h5") as run:
        # four fifths of 1050 samples are 840, of which 750 are whole periods
        assert [(s.label, s.start, s.stop) for s in run.segments] == [("fit", 0, 750), ("held-out", 750, 1050)]


def test_names_that_differ_in_the_letter_of_an_axis_alone_are_axes(tmp_path):
    names = ["fx", "fy", "fz", "x", "y", "z"]
    columns = [np.arange(300) * 1e-3, *np.random.default_rng(4).standard_normal((6, 300))]
    proposed(
        tmp_path,
        table(
            tmp_path, ";".join(["t [s]", *(f"{n} [N]" for n in names[:3]), *(f"{n} [m]" for n in names[3:])]), columns
        ),
    )
    made = import_run(tmp_path / "map.toml", tmp_path / "a.h5")
    expected = {n: ("input" if n.startswith("f") else "output", n[-1]) for n in names}
    assert {c.name: (c.role, c.dof) for c in made.channels} == expected


def test_of_several_files_one_may_be_held_out_by_its_label(tmp_path):
    columns = [np.arange(200) * 1e-3, U, Y]
    text, _ = proposed(tmp_path, *(table(tmp_path, "t [s];u [N];y [m]", columns, name) for name in ("a.csv", "b.csv")))
    assert "held-out into the label of a part" in text and "[segments]" not in text


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


def imported(tmp_path: Path, path: Path) -> tuple[dict[str, np.ndarray], str]:
    """Return the channels that a proposed map gives when it is imported as it stands, and what was said."""
    _, said = proposed(tmp_path, path)
    import_run(tmp_path / "map.toml", tmp_path / "a.log.h5")
    with read_run(tmp_path / "a.log.h5") as run:
        assert run.sample_rate_hz == pytest.approx(1000.0)
        return {name: run.read(name) for name in run.channels}, said


def hdf5_groups(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name, values, unit in (("t", T, "s"), ("torque", U, "mN m"), ("angle", Y, "mrad")):
            file[f"run 1/daq/{name}"] = values
            file[f"run 1/daq/{name}"].attrs["units"] = unit
        file["run 1/daq/calibration"] = np.arange(3.0)
        file["run 1/daq/again"] = h5py.SoftLink("/run 1/daq/t")
        file["run 1/daq/itself"] = file["run 1"]


def hdf5_compound(path: Path) -> None:
    table = np.zeros(200, [("t_s", "f8"), ("daq", [("torque", "f8"), ("angle", "f8")])])
    table["t_s"], table["daq"]["torque"], table["daq"]["angle"] = T, 1e-3 * U, 1e-3 * Y
    with h5py.File(path, "w") as file:
        file["run/table"] = table


def matlab_structure(path: Path) -> None:
    inner = {"torque": 1e-3 * U, "angle": 1e-3 * Y, "note": "warm"}
    scipy.io.savemat(path, {"rec": {"t": T, "daq": inner}, "list": np.zeros((2, 2), dtype=object)})


def matlab_73_structure(path: Path) -> None:
    write_mat73(path, {})
    with h5py.File(path, "r+") as file:
        for name, values in (("t", T), ("daq/torque", 1e-3 * U), ("daq/angle", 1e-3 * Y)):
            file[f"rec/{name}"] = values[None, :]
        file["#refs#/a"] = T


def lying_matrix(path: Path) -> None:
    scipy.io.savemat(path, {"t": T, "data": 1e-3 * np.stack([U, Y])})


NESTED = {
    "a.h5": (hdf5_groups, ("torque", "angle")),
    "b.h5": (hdf5_compound, ("torque", "angle")),
    "c.mat": (matlab_structure, ("torque", "angle")),
    "d.mat": (matlab_73_structure, ("torque", "angle")),
    "e.mat": (lying_matrix, ("data_0", "data_1")),
}


@pytest.mark.parametrize("name", NESTED)
def test_groups_fields_and_structures_are_walked(tmp_path, name):
    write, (torque, angle) = NESTED[name]
    write(tmp_path / name)
    channels, said = imported(tmp_path, tmp_path / name)
    np.testing.assert_allclose(channels[torque], 1e-3 * U, rtol=1e-15)
    np.testing.assert_allclose(channels[angle], 1e-3 * Y, rtol=1e-15)
    assert set(channels) == {torque, angle}
    if name == "a.h5":
        assert "'run 1/daq/calibration' is left out: it has 3 samples, most have 200" in said
        assert "'run 1/daq/again' is left out" in said and "torque' is taken for input" in said
    if name == "c.mat":
        assert "'rec.daq.note' is left out" in said and "'list' is left out" in said


def test_equal_names_in_two_groups_stay_apart_and_a_second_clock_is_no_output(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for run, factor in (("first", 1.0), ("second", 2.0)):
            file[f"{run}/t"], file[f"{run}/u"], file[f"{run}/y"] = T, factor * U, factor * Y
    channels, said = imported(tmp_path, tmp_path / "a.h5")
    assert set(channels) == {"first_u", "first_y", "t", "second_u", "second_y"}
    np.testing.assert_array_equal(channels["second_y"], 2.0 * Y)
    assert "'second/t' is taken for aux: it is another clock" in said


def archive(decimal: str, dated: bool) -> str:
    start = np.datetime64("2026-11-25T11:00:00.000", "ms")
    rows = []
    for k in range(200):
        stamp = str(start + np.timedelta64(k, "ms")) if dated else repr(float(T[k]))
        rows += [(stamp, "pump", repr(float(U[k]))), (stamp, "level", repr(float(Y[k])))]
        rows += [(stamp, "door", "closed")] if k % 50 == 0 else []
    lines = [";".join(row) for row in rows]
    return "time;channel;reading\n" + "\n".join(lines).replace(".", decimal) + "\n"


@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("dated", [False, True])
def test_a_line_per_reading_is_proposed_as_an_archive(tmp_path, decimal, dated):
    (tmp_path / "a.csv").write_text(archive(decimal, dated), encoding="utf-8")
    channels, said = imported(tmp_path, tmp_path / "a.csv")
    assert set(channels) == {"pump", "level"}
    np.testing.assert_allclose(channels["pump"], U, rtol=1e-9)
    np.testing.assert_allclose(channels["level"], Y, rtol=1e-9)
    assert "archive" in said and "'door' is left out" in said and "'pump' is taken for input" in said


def test_a_table_with_a_remark_in_words_is_no_archive(tmp_path):
    words = np.where(np.arange(200) % 2, "up", "down")
    rows = [f"{float(t)!r};{float(u)!r};{float(y)!r};{word}" for t, u, y, word in zip(T, U, Y, words, strict=True)]
    (tmp_path / "a.csv").write_text("t;u;y;way\n" + "\n".join(rows) + "\n", encoding="utf-8")
    channels, said = imported(tmp_path, tmp_path / "a.csv")
    assert set(channels) == {"u", "y"} and "archive" not in said and "'way' is left out" in said


def test_a_table_that_can_be_read_in_two_ways_is_proposed_with_its_doubt(tmp_path):
    whole = np.column_stack([1000.0 * U + 5000.0, 1000.0 * Y + 5000.0, np.arange(200) % 7]).astype(int)
    rows = "".join(f"{u},{y},{n}\n" for u, y, n in whole.tolist())
    (tmp_path / "a.csv").write_text(rows, encoding="utf-8")
    text, said = proposed(tmp_path, tmp_path / "a.csv")
    assert "DOUBTFUL" in said and "digits behind a decimal comma" in said and 'delimiter = ","' in text
    import_run(tmp_path / "map.toml", tmp_path / "a.log.h5")
    with read_run(tmp_path / "a.log.h5") as run:
        assert [run.read(name)[0] for name in run.channels] == [float(cell) for cell in rows.split("\n")[0].split(",")]


def test_what_is_left_out_is_told_where_nothing_can_be_proposed(tmp_path):
    """With file, line and cell, once for all columns that one line breaks, and how to take columns of one name."""
    lines = [f"{k / 1000},{k % 7},{k % 5}" for k in range(40)]
    broken = [*lines[:10], "0.010,1", *lines[11:]]
    with pytest.raises(DataError, match=r"'t', 'u', 'y' are left out: .*line 12 has 2 cells") as told:
        guess([written(tmp_path, "short.csv", ["t,u,y", *broken])], tmp_path)
    assert str(told.value).count("line 12") == 1
    bad = [*lines[:10], "0.010,1,#N/A", *lines[11:]]
    with pytest.raises(DataError, match=r"'y' is left out: .*line 12: column 'y' holds '#N/A'"):
        guess([written(tmp_path, "bad.csv", ["t,u,y", *bad])], tmp_path)
    with pytest.raises(DataError, match=r'no name of its own: select = "\[:, 2\]" takes it'):
        guess([written(tmp_path, "twice.csv", ["t,y,y", *lines])], tmp_path)


def written(folder: Path, name: str, lines: list[str]) -> Path:
    (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / name
