"""What the tests of the serial bench share: emulated benches in processes of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from campaigns.serial import EmulatorProcess, ServeOptions, emulator
from sim_backend.bench import Gate, Learning, Record, Segment
from sim_backend.control.blocks import filter_from_zpk
from sim_backend.model import dump_model
from tests.running import PYTHON
from tests.small_bench import NOISE, bench_model

RATE_HZ = 10_000.0
REMARKS = ("refused", "remote")


class Served:
    """An emulated bench, with the journal that it keeps."""

    def __init__(self, process: EmulatorProcess, journal: Path) -> None:
        self.process = process
        self.address = process.address
        self._journal = journal

    @property
    def journal(self) -> list[str]:
        """The states it has entered, each with its reason."""
        return [line.split(" s ", 1)[1].strip() for line in self._journal.read_text().splitlines()]

    @property
    def state(self) -> str:
        """The state it is in; what it says of strangers is none."""
        return [word for word in (line.split()[0] for line in self.journal) if word not in REMARKS][-1]


Serve = Callable[..., Served]


@pytest.fixture(autouse=True)
def forked(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fork the processes of emulated benches from one that has imported all they need, unless a test starts them."""
    if "started" not in request.fixturenames:
        monkeypatch.setattr(emulator, "COMMAND", (*PYTHON, "-m", "campaigns.serial"))


@pytest.fixture
def started() -> None:
    """Let emulated benches start as they do for users."""


@pytest.fixture
def model_path(tmp_path: Path) -> str:
    """Return the small bench with sensor noise as a file."""
    path = tmp_path / "small.toml"
    path.write_text(dump_model(bench_model(NOISE)), encoding="utf-8")
    return str(path)


@pytest.fixture
def serve(tmp_path: Path, model_path: str) -> Iterator[Serve]:
    """Return a function that starts an emulated bench; all end with the test."""
    started: list[EmulatorProcess] = []

    def begin(**options: Any) -> Served:
        journal = tmp_path / f"journal-{len(started)}"
        with journal.open("wb") as file:
            process = EmulatorProcess(ServeOptions(**{"bench": f"sim:{model_path}", "seed": 5, **options}), file)
        started.append(process)
        return Served(process, journal)

    yield begin
    for process in started:
        process.close()


def noise_segment(label: str, n_samples: int, record: tuple[str, ...] = (), seed: int = 0) -> Segment:
    """Return an open-loop segment of 500 samples of noise, repeated."""
    wave = 1e-4 * np.random.default_rng(seed).standard_normal((500, 3))
    return Segment(label, n_samples, np.zeros_like(wave), wave, record=record)


def loop_segments() -> list[Segment]:
    """Return segments that leave something behind for the next: learned inputs, integrators, closed loops."""
    rng = np.random.default_rng(3)
    wave = 1e-5 * rng.standard_normal((200, 3))
    pi = filter_from_zpk([0.99], [1.0], 1e-3, RATE_HZ)
    low = filter_from_zpk([-1.0], [0.5], 0.1, RATE_HZ)
    learning = Learning(low, 0.1, 2, 200, (0.25, 0.5, 0.25))
    closed = Segment(
        "closed",
        1900,
        wave,
        wave,
        feedback=(pi, None, pi),
        gates=(Gate(3, 0, True, 1e-6), Gate(7, 2, True), Gate(150, 2, False)),
        learning=(None, learning, None),
        cold_finger_k=63.5,
    )
    frozen = Segment("frozen", 1000, wave, wave, feedback=(pi, None, pi), learning=(None, learning, None))
    return [noise_segment("open", 1234), closed, frozen, noise_segment("after", 700, ("theta_y", "command_z"), 7)]


def differences(got: Record, expected: Record) -> list[str]:
    """Name the channels that are not the same bit for bit."""
    if list(got.channels) != list(expected.channels):
        return [f"channels {list(got.channels)} for {list(expected.channels)}"]
    return [name for name, right in expected.channels.items() if got.channels[name].tobytes() != right.tobytes()]
