"""Pipes, devices and folders where commands keep or expect small files: one line at once, and nothing is replaced."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from analysis.study.store import Store
from campaigns.playing.campaign_run import LOCK_FILE, STATE_FILE
from mccdcli.main import main
from sim_backend.errors import MccdError


def pipe(path: Path) -> None:
    os.mkfifo(path)


def endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


MAKERS = pytest.mark.parametrize("make", [pipe, endless, Path.mkdir], ids=["pipe", "endless", "folder"])


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """Return a function that runs a command, which must end at once with one line: its exit code and the line."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MCCD_CONFIG", raising=False)

    def run(*command: str) -> tuple[int, str]:
        started_s = time.monotonic()
        code = main(list(command))
        said = capsys.readouterr().err
        assert said.startswith("mccd: error: ") and said.count("\n") == 1, said
        assert time.monotonic() - started_s < 10.0
        return code, said

    return run


@MAKERS
@pytest.mark.parametrize("name", [LOCK_FILE, STATE_FILE])
def test_the_files_of_a_campaign(tmp_path, refused, make, name):
    (tmp_path / "c").mkdir()
    make(tmp_path / "c" / name)
    code, said = refused("campaign", "run", "quick", "--out", "c")
    assert code in (2, 4) and name in said and ("ordinary file" in said or "is a link" in said)
    assert not (tmp_path / "c" / name).is_file()


@MAKERS
@pytest.mark.parametrize(
    ("command", "name"),
    [
        (["import", "map.toml", "-o", "a.h5"], "map.toml"),
        (["campaign", "show", "./c.toml"], "c.toml"),
        (["study", "s.toml", "--out", "o"], "s.toml"),
        (["watch", "a.h5", "--model", "./m.toml"], "m.toml"),
        (["challenge", "pool", "p.json"], "p.json"),
        (["log", "show", "run.h5"], "run.h5"),
    ],
)
def test_files_that_a_command_is_given(tmp_path, refused, make, command, name):
    make(tmp_path / name)
    code, said = refused(*command)
    assert code in (2, 4) and name in said


@MAKERS
def test_defaults_of_the_folder(tmp_path, refused, make):
    make(tmp_path / "mccd.toml")
    code, said = refused("config", "show")
    assert code == 2 and "mccd.toml" in said


@MAKERS
def test_the_store_of_a_study(tmp_path, make):
    make(tmp_path / "trials.sqlite")
    with pytest.raises(MccdError, match=r"trials\.sqlite.*(ordinary file|is a link)"):
        Store(tmp_path, {}, (), (), resume=True)


@MAKERS
@pytest.mark.parametrize("name", ["challenge.json", "seal.txt", "truth/truth.bin"])
def test_the_files_of_a_challenge(tmp_path, refused, make, name):
    (tmp_path / "truth").mkdir()
    for other in ("challenge.json", "seal.txt", "truth/truth.bin"):
        if other != name:
            (tmp_path / other).write_text('{"cases": ["0001"]}')
    make(tmp_path / name)
    code, said = refused("challenge", "score", str(tmp_path))
    assert code in (2, 4) and ("not an ordinary file" in said or "seal" in said)
