"""How finely a source keeps its numbers is told, whatever the samples look like in SI."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from campaigns.facts import Fact, facts_of
from campaigns.facts.precision import Precision, coarsest
from campaigns.importing import import_run
from campaigns.importing.cells import digits_of
from campaigns.log import read_run
from mccdcli.main import main

RNG = np.random.default_rng(5)
U, Y = RNG.standard_normal(300), RNG.standard_normal(300)
CHANNELS = """
[channels.u]
select = "u"
unit = "mN m"
role = "input"
[channels.y]
select = "y"
unit = "mrad"
role = "output"
"""


def precision_of(folder: Path, source: str, more: str = "", channels: str = CHANNELS) -> dict[str, Fact]:
    head = f'[log]\ntest = "t"\nsource = "{source}"\n{more or "sample_rate_hz = 100.0"}\n'
    (folder / "map.toml").write_text(head + channels, encoding="utf-8")
    import_run(folder / "map.toml", folder / "out.h5")
    with read_run(folder / "out.h5") as run:
        return {fact.channel: fact for fact in facts_of(run) if fact.name == "precision"}


def write_text(path: Path, form: str, y: np.ndarray = Y) -> None:
    np.savetxt(path, np.column_stack([U, y]), form, ",", header="u,y", comments="")


@pytest.mark.parametrize(("form", "digits"), [("%.6g", 6), ("%.9e", 10), ("%.17g", 17)])
def test_digits_of_a_text(tmp_path, form, digits):
    write_text(tmp_path / "a.csv", form)
    found = precision_of(tmp_path, "a.csv")
    assert found["y"].numbers["digits"] == pytest.approx(digits, abs=form == "%.17g")  # %.17g leaves noughts out
    assert f"{found['y'].numbers['digits']:.0f} significant digits" in found["y"].finding


@pytest.mark.parametrize(("dtype", "bits"), [("f4", 24), ("f8", 53), ("f2", 11)])
def test_bits_of_a_float_and_what_they_round(tmp_path, dtype, bits):
    stored = Y.astype(dtype)
    np.savez(tmp_path / "a.npz", u=U, y=stored)
    found = precision_of(tmp_path, "a.npz")
    assert found["u"].numbers["bits"] == 53
    assert found["y"].numbers["bits"] == bits and not found["y"].remark
    # half of the last place of the largest number, in whatever unit
    rounding = 0.5 * float(np.spacing(np.abs(stored).max()))
    assert 0.5 * rounding <= found["y"].numbers["share"] * stored.astype(float).std() <= 2.0 * rounding


def test_an_offset_that_leaves_few_bits_for_the_motion_is_a_remark(tmp_path):
    np.savez(tmp_path / "a.npz", u=U, y=(1e5 + Y * 0.1).astype("f4"))
    found = precision_of(tmp_path, "a.npz")["y"]
    assert found.remark and "rounding is part of its noise" in found.means and found.numbers["share"] > 0.01


def test_whole_numbers_of_every_kind(tmp_path):
    counts = np.round(1000.0 * Y).astype("i2")
    np.savez(tmp_path / "a.npz", u=U, y=counts)
    assert precision_of(tmp_path, "a.npz")["y"].numbers == {"bits": 16}
    (tmp_path / "out.h5").unlink()
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["u"], file["y"] = U, counts
        file["y"].attrs["scale_factor"] = 1e-3
    assert "whole numbers of 16 bits" in precision_of(tmp_path, "a.h5")["y"].finding
    (tmp_path / "out.h5").unlink()
    scipy.io.savemat(tmp_path / "a.mat", {"u": U, "y": counts})
    assert precision_of(tmp_path, "a.mat")["y"].numbers == {"bits": 16}
    (tmp_path / "out.h5").unlink()
    write_text(tmp_path / "a.csv", "%d", 1000.0 * Y)
    # u is 0 and 1 then, which are whole numbers as well
    assert "written in whole numbers" in precision_of(tmp_path, "a.csv")["y"].finding


def test_a_sum_and_several_parts_are_as_coarse_as_their_coarsest(tmp_path):
    np.savez(tmp_path / "a.npz", u=U, y=Y, z=Y.astype("f4"))
    summed = CHANNELS.replace('select = "y"', "combine = { y = 0.5, z = 0.5 }")
    assert precision_of(tmp_path, "a.npz", channels=summed)["y"].numbers["bits"] == 24
    (tmp_path / "out.h5").unlink()
    parts = CHANNELS + '[[parts]]\nlabel = "a"\n[[parts]]\nlabel = "b"\nselect = { y = "z" }\n'
    assert precision_of(tmp_path, "a.npz", channels=parts)["y"].numbers["bits"] == 24
    assert coarsest([Precision(bits=53, largest=1.0), None]) is None


def test_readings_of_an_archive(tmp_path):
    rows = [f"{0.01 * k:.2f};{name};{value:.5e}" for k in range(300) for name, value in (("u", U[k]), ("y", Y[k]))]
    (tmp_path / "a.csv").write_text("t;n;v\n" + "\n".join(rows) + "\n")
    more = 'sample_rate_hz = 100.0\nresample = "hold"\narchive = { time = "t", name = "n", value = "v" }'
    assert precision_of(tmp_path, "a.csv", more)["y"].numbers["digits"] == 6


@pytest.mark.parametrize(
    ("cell", "found"),
    [("-0.00125", (3, False)), ("1.500", (4, False)), ("1.5D-03", (2, False)), ("1200", (4, True)), ("0", (0, True))],
)
def test_digits_are_counted_from_the_first_that_is_no_nought(cell, found):
    assert digits_of(cell, ".") == found


def test_the_check_of_a_log_shows_it(tmp_path, capsys):
    write_text(tmp_path / "a.csv", "%.6g")
    precision_of(tmp_path, "a.csv")
    assert main(["log", "check", str(tmp_path / "out.h5"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {fact["channel"] for fact in told["facts"] if fact["name"] == "precision"} == {"u", "y"}
