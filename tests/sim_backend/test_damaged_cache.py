"""Whatever has become of compiled code on disk: no crash, the same numbers, one warning at most."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sim_backend.kernel_cache import VARIABLE
from tests.running import PYTHON

PLAY = """
import hashlib, json, os, random, sys, warnings
import numpy as np
from sim_backend.bench import Segment
from sim_backend.effects import view
from sim_backend.kernel import machine
from sim_backend.model import parse_model
from sim_backend.simbench import SimBench

MODEL = '''
schema = "mccd-model/1"
name = "one axis"
sample_rate_hz = 10000.0
inputs = [{ name = "torque_x", unit = "N m", dof = "theta_x" }]
outputs = [{ name = "theta_x", unit = "rad", dof = "theta_x" }]
effects = [
  { effect = "sensor-noise", where = "theta_x", parameters.std = 1e-6 },
  { effect = "coulomb-friction", where = "theta_x", parameters.torque = 1e-4 },
]
modes = [{ label = "a", frequency_hz = 29.6, decay_rate_1_s = 4.7, input.torque_x = 3096.0, output.theta_x = 1.0 }]
'''

def numbers():
    wave = 1e-3 * np.sin(np.arange(40.0))[:, None]
    segment = Segment("a", 200, np.zeros_like(wave), wave)
    parts = list(SimBench(parse_model(MODEL, "here"), 1).play(segment).channels.values())
    scores, line = np.empty(3), np.arange(50.0)  # of a kernel that numba keeps
    view._mode_scores(np.exp(1j * line), np.cos(line) + 0j, line, np.array([5.0, 9.0, 20.0]), 0.1, scores)
    return hashlib.sha256(b"".join(part.tobytes() for part in [*parts, scores])).hexdigest()

def said():
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        found = numbers()
        machine.wait()  # loops that are made aside, meanwhile
    return [found, [str(w.message) for w in warned if "kernel cache" in str(w.message)]]
"""
SAY = PLAY + "print(json.dumps(said()))"

FLIP = (
    PLAY
    + """
folder, rng, told = sys.argv[1], random.Random(1), []
for name in sys.argv[2:]:
    path = os.path.join(folder, name)
    with open(path, "rb") as file:
        whole = file.read()
    at = rng.randrange(8 * len(whole))
    with open(path, "r+b") as file:
        file.seek(at // 8)
        file.write(bytes([whole[at // 8] ^ 1 << at % 8]))
    out, into = os.pipe()
    pid = os.fork()  # a process of its own, whose end tells of a crash
    if pid == 0:
        os.write(into, json.dumps(said()).encode())
        os._exit(0)
    _, status = os.waitpid(pid, 0)
    os.close(into)
    with os.fdopen(out) as answer, open(path, "rb") as file:
        told.append([os.waitstatus_to_exitcode(status), answer.read(), file.read() == whole])
    with open(path, "wb") as file:
        file.write(whole)
print(json.dumps(told))
"""
)


def run(code: str, cache: str | Path, *arguments: str) -> Any:
    """Return what a process says that keeps its code in `cache`."""
    done = subprocess.run(
        [*PYTHON, "-c", code, *arguments],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {VARIABLE: str(cache)},
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A cache with code of every kind, and the numbers that are right."""
    folder = tmp_path_factory.mktemp("cache") / "kernels"
    right, warned = run(SAY, folder)
    assert warned == []
    return folder, right


@pytest.fixture
def cache(filled: tuple[Path, str], tmp_path: Path) -> Path:
    """A copy of it, to be damaged."""
    return Path(shutil.copytree(filled[0], tmp_path / "kernels"))


def kinds(folder: Path) -> list[str]:
    """One file of each kind of code: a loop, a callback, what numba keeps."""
    found = sorted(path.name for path in folder.iterdir())
    one_of = [next(name for name in found if part in name) for part in ("loop-", "fill-", "mode_scores-")]
    assert len(set(one_of)) == 3
    return one_of


@pytest.mark.parametrize("times", [1, 17])
def test_no_flipped_bit_in_code_crashes_or_changes_a_number(cache: Path, filled: tuple[Path, str], times: int) -> None:
    names = times * kinds(cache)
    for name, (code, answer, same) in zip(names, run(FLIP, cache, str(cache), *names), strict=True):
        assert code == 0, name
        found, warned = json.loads(answer)
        assert found == filled[1], name
        assert len(warned) == 1 and name in warned[0], name
        # what is made again is good; numba's own form has names of its own each time
        assert same or name.startswith("mode_scores")


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:100])


def _empty(path: Path) -> None:
    path.write_bytes(b"")


def _fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _link(path: Path) -> None:
    path.rename(path.with_name("elsewhere"))
    path.symlink_to("elsewhere")


def _of_all(path: Path) -> None:
    path.chmod(0o666)


@pytest.mark.parametrize("change", [_cut, _empty, _fifo, _link, _of_all], ids=lambda change: change.__name__)
def test_files_that_cannot_be_trusted_take_longer_and_are_told_of_once(
    cache: Path, filled: tuple[Path, str], change: Callable[[Path], None]
) -> None:
    for name in kinds(cache):
        change(cache / name)
    found, warned = run(SAY, cache)
    assert found == filled[1]
    assert len(warned) == 1


def test_a_cache_that_cannot_be_written_takes_longer_and_is_told_of_once(filled: tuple[Path, str]) -> None:
    found, warned = run(SAY, "/proc/self/kernels")
    assert found == filled[1]
    assert len(warned) == 1 and "no folder to keep compiled code in" in warned[0]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
@pytest.mark.parametrize("which", ["folder", "file"])
def test_what_belongs_to_another_user_is_not_used(cache: Path, filled: tuple[Path, str], which: str) -> None:
    for path in [cache] if which == "folder" else list(cache.iterdir()):
        os.chown(path, 54321, 54321)
    found, warned = run(SAY, cache)
    assert found == filled[1]
    assert len(warned) == 1


def test_two_processes_that_compile_at_once_get_the_same(tmp_path: Path, filled: tuple[Path, str]) -> None:
    environment = os.environ | {VARIABLE: str(tmp_path / "kernels")}
    both = [
        subprocess.Popen([sys.executable, "-c", SAY], stdout=subprocess.PIPE, text=True, env=environment)
        for _ in range(2)
    ]
    for process in both:
        out, _ = process.communicate(timeout=300)
        assert process.returncode == 0
        assert json.loads(out) == [filled[1], []]
    assert not [path for path in (tmp_path / "kernels").iterdir() if path.name.startswith(".new-")]
