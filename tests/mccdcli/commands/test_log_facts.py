"""`mccd log check` says what it found and exits with 1 where that forbids a log; `mccd log show` gives its sizes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import campaigns.facts.sizes
from campaigns.importing import import_run
from campaigns.log import Channel, LogWriter
from mccdcli.main import main

RATE_HZ = 500.0
ROWS = 3000


def played(period: int = 500) -> tuple[np.ndarray, np.ndarray]:
    """Return a multisine of `period` samples in N m and the angle that a lag with 1 % noise makes of it, in rad."""
    rng = np.random.default_rng(5)
    t = np.arange(ROWS) / period
    torque = sum(np.cos(2.0 * np.pi * (k * t + phase)) for k, phase in enumerate(rng.uniform(size=30), 1))
    angle = np.convolve(torque, np.exp(-np.arange(60) / 12.0))[:ROWS]
    return torque, 1e-4 * (angle + 0.01 * angle.std() * rng.standard_normal(ROWS))


def written(path: Path, columns: dict[str, np.ndarray], settings: dict[str, int]) -> Path:
    channels = [
        Channel("torque", "N m", "input", "theta_x", RATE_HZ),
        Channel("angle", "rad", "output", "theta_x", RATE_HZ),
        *([Channel("room", "K", "aux", "", RATE_HZ)] if "room" in columns else []),
    ]
    with (
        LogWriter.create(path, channels, test="multisine", bench={"kind": "sim", "name": "n"}) as log,
        log.segment("levels", settings),
    ):
        log.append(columns)
    return path


def rows_of(text: str, name: str) -> list[str]:
    return [line for line in text.splitlines() if line.split()[:1] == [name]]


def test_a_claimed_period_that_is_one_sample_off_forbids_the_log(tmp_path, capsys) -> None:
    torque, angle = played()
    path = written(tmp_path / "a.h5", {"torque": torque, "angle": angle}, {"period_samples": 499})
    assert main(["log", "check", str(path)]) == 1
    (row,) = rows_of(capsys.readouterr().out, "period")
    assert "the input does not repeat after 499 samples" in row and "say period = 500" in row
    assert "FORBIDS: every frequency and every noise computed with it is wrong" in row
    assert main(["log", "check", str(path), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    (fact,) = [fact for fact in told["facts"] if fact["name"] == "period"]
    assert told["usable"] is False and fact["forbids"] and fact["numbers"]["right"] == 500
    # what refuses the log gives the same reason
    assert main(["identify", "--log", str(path), "-o", str(tmp_path / "m.toml")]) == 4
    assert "say period = 500" in capsys.readouterr().err


def test_a_sound_log_is_usable(tmp_path, capsys) -> None:
    torque, angle = played()
    path = written(tmp_path / "a.h5", {"torque": torque, "angle": angle}, {"period_samples": 500})
    assert main(["log", "check", str(path)]) == 0
    text = capsys.readouterr().out
    (row,) = rows_of(text, "period")
    assert "the input repeats after 500 samples" in row and "FORBIDS" not in text
    assert main(["log", "check", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["usable"] is True and not [fact for fact in told["facts"] if fact["remark"] or fact["forbids"]]


def test_check_shows_coherence_by_thirds_of_an_octave(tmp_path, capsys) -> None:
    torque, angle = played()
    path = written(tmp_path / "a.h5", {"torque": torque, "angle": angle}, {"period_samples": 500})
    main(["log", "check", str(path)])
    # 30 lines of 1 Hz: all thirds of an octave from 1 Hz on but those between 1 Hz, 2 Hz and 3 Hz
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "thirds of an octave" in line]
    assert "1 to 31.6 Hz: " in line and line.count("–") == 3
    main(["log", "check", str(path), "--json"])
    (fact,) = [fact for fact in json.loads(capsys.readouterr().out)["facts"] if fact["name"] == "coherence"]
    assert [round(band["frequency_hz"], 2) for band in fact["bands"][:3]] == [1.0, 2.0, 3.16]
    assert all(0.9 < band["share"] <= 1.0 for band in fact["bands"])


def sizes(capsys, path: Path) -> tuple[dict[str, Any], str]:
    """Return what `log show` says as JSON and as text."""
    assert main(["log", "show", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert main(["log", "show", str(path)]) == 0
    return told, capsys.readouterr().out


def test_show_gives_the_sizes_of_a_log_without_facts(tmp_path, capsys) -> None:
    torque, angle = played()
    room = 293.0 + 0.1 * np.sin(np.arange(ROWS) / 700.0)
    room[7] = np.nan
    path = written(tmp_path / "a.h5", {"torque": torque, "angle": 2.0 + angle, "room": room}, {})
    told, text = sizes(capsys, path)
    for name, values in (("torque", torque), ("angle", 2.0 + angle), ("room", np.delete(room, 7))):
        right = (values.min(), values.max(), np.sqrt(np.mean((values - values.mean()) ** 2)))
        size = told["sizes"][name]
        assert (size["smallest"], size["largest"], size["rms"]) == pytest.approx(right, rel=1e-9)
        assert rows_of(text, name)[0].split()[-3:] == [f"{value:.6g}".replace("-", "−") for value in right]
    assert told["sized_samples"] == ROWS and told["unknown_sizes"] == {} and told["facts"] == []
    assert "rms about the mean" in text and "first" not in text


def test_show_bounds_what_it_reads_and_says_so(tmp_path, capsys, monkeypatch) -> None:
    torque, angle = played()
    path = written(tmp_path / "a.h5", {"torque": torque, "angle": angle}, {})
    monkeypatch.setattr(campaigns.facts.sizes, "MOST_NUMBERS", 2000)
    told, text = sizes(capsys, path)
    assert told["sized_samples"] == 1000 and told["sizes"]["angle"]["largest"] == angle[:1000].max()
    assert "sizes are of the first 1000 samples" in text


def test_show_takes_the_sizes_and_facts_that_an_import_has_left(tmp_path, capsys) -> None:
    torque, angle = played()
    lost = np.delete(np.arange(ROWS), [50, 51])
    np.savez(tmp_path / "a.npz", t=lost / RATE_HZ, u=torque[lost], y=angle[lost])
    (tmp_path / "map.toml").write_text(
        '[log]\ntest = "t"\nsource = "a.npz"\ntime = "t"\nresample = "cubic"\n'
        '[channels.torque]\nselect = "u"\nunit = "N m"\nrole = "input"\n'
        '[channels.angle]\nselect = "y"\nunit = "mrad"\nrole = "output"\n'
    )
    import_run(tmp_path / "map.toml", tmp_path / "b.h5")
    told, text = sizes(capsys, tmp_path / "b.h5")
    stored = {fact["channel"]: fact["numbers"] for fact in told["facts"] if fact["name"] == "size"}
    assert told["sizes"] == stored and set(stored) == {"torque", "angle"}
    assert stored["angle"]["rms"] == pytest.approx(1e-3 * angle.std(), rel=0.01)
    assert ["torque", "angle"] == [line.split()[1].rstrip(":") for line in rows_of(text, "resampled")]
    assert rows_of(text, "size") == []


def test_show_of_a_damaged_log_gives_what_can_be_read(tmp_path, capsys) -> None:
    torque, angle = played()
    path = written(tmp_path / "a.h5", {"torque": torque, "angle": angle}, {})
    with h5py.File(path) as file:
        place = file["channels/angle"].id.get_chunk_info(0).byte_offset
    contents = bytearray(path.read_bytes())
    contents[place + 100] ^= 1
    path.write_bytes(contents)
    path.with_name("a.h5.sha256").unlink()  # a run that was killed has none
    told, text = sizes(capsys, path)
    assert list(told["sizes"]) == ["torque"] and "angle" in told["unknown_sizes"]
    assert "no size of angle: " in text and "cannot be read" in text
