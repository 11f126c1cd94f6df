"""A diagnosis opens nothing of a challenge but its own case and its own result.

An audit hook in the process of the diagnosis, and in whatever that starts, writes down what Python opens or lists below
the challenge's folder. Logs are opened by the HDF5 library, which tells no hook; the truth is not an HDF5 file.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest

from analysis.challenge.make import Counts, make_challenge
from analysis.challenge.run import run_challenge
from mccdcli.main import main

HOOK = """
import os, sys

FOLDER, OPENED = os.environ["CHALLENGE_FOLDER"], os.environ["OPENED_FILES"]

def note(event, arguments):
    if event in ("open", "os.listdir", "os.scandir") and isinstance(arguments[0], (str, bytes, os.PathLike)):
        path = os.path.realpath(os.fsdecode(arguments[0]))
        if path.startswith(FOLDER + os.sep):
            with open(OPENED, "a") as file:
                file.write(os.path.relpath(path, FOLDER) + "\\n")

sys.addaudithook(note)
"""

ROOT = Path(__file__).parents[3]

PEEKS = {
    "reads the truth": ("open('../../truth/truth.bin', 'rb').read()", ["truth/truth.bin"]),
    "reads it by a number": ("import os; os.open('../../truth/truth.bin', os.O_RDONLY)", ["truth/truth.bin"]),
    "lets a child read it": (
        "import subprocess, sys; subprocess.run([sys.executable, '-c', 'open(\"../../truth/truth.bin\")'], check=True)",
        ["truth/truth.bin"],
    ),
    "reads another case": ("open('../0001/nominal.toml').read()", ["cases/0001/nominal.toml"]),
    "lists the results": ("import os; os.listdir('../../results')", ["results"]),
    "reads its own case": ("open('nominal.toml').read()", []),
}
"""What a diagnosis might do, and what of it is none of its business."""


@pytest.fixture(scope="module")
def challenge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("challenge").resolve()
    make_challenge(folder, Counts(one=0, none=2), seed=6, shape="short")
    return folder


@pytest.fixture
def opened(challenge: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file in which processes of this test write what they open; each begins with the hook."""
    (tmp_path / "sitecustomize.py").write_text(HOOK)
    shutil.rmtree(challenge / "results", ignore_errors=True)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(ROOT)]))
    monkeypatch.setenv("CHALLENGE_FOLDER", str(challenge))
    monkeypatch.setenv("OPENED_FILES", str(tmp_path / "opened.txt"))
    (tmp_path / "opened.txt").touch()
    return tmp_path / "opened.txt"


def foreign(opened: Path, case: str) -> list[str]:
    """What was opened that is neither of the case nor of its result."""
    own = (f"cases/{case}", f"results/{case}")
    return sorted({p for p in opened.read_text().splitlines() if not any(p == o or p.startswith(o + "/") for o in own)})


@pytest.mark.slow
def test_a_diagnosis_opens_its_own_case_and_nothing_else(challenge: Path, opened: Path) -> None:
    assert main(["challenge", "run", str(challenge), "--from", "0002"]) == 0
    seen = set(opened.read_text().splitlines())
    # the hook was there, from the model that is read to the result that is written
    assert "cases/0002/nominal.toml" in seen
    assert any(p.startswith("results/0002/") for p in seen)
    assert foreign(opened, "0002") == []


@pytest.mark.parametrize("how", PEEKS)
def test_what_a_diagnosis_opens_is_seen(challenge: Path, opened: Path, how: str) -> None:
    words, expected = PEEKS[how]
    (outcome,) = run_challenge(challenge, first="0002", command=(sys.executable, "-c", words))
    assert outcome.exit_code == 0
    assert foreign(opened, "0002") == expected
