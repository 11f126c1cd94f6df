"""A small log and its values, which the tests of this folder share."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from campaigns.log import Channel, LogWriter, sidecar_of

RATE_HZ = 10_000.0


def two_channels() -> list[Channel]:
    return [
        Channel("torque_x", "N m", "input", "theta_x", RATE_HZ),
        Channel("angle_x", "rad", "output", "theta_x", RATE_HZ, 5e-5),
    ]


def values(rows: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(7)
    return {"torque_x": rng.normal(size=rows), "angle_x": 1e-3 * rng.normal(size=rows)}


@pytest.fixture
def channels() -> list[Channel]:
    return two_channels()


def write_small_log(path: Path) -> dict[str, np.ndarray]:
    """Write a closed log of 1000 rows in chunks of 128, two segments with a gap of 100 rows between them."""
    data = values(1000)

    def rows(start: int, stop: int) -> dict[str, np.ndarray]:
        return {name: column[start:stop] for name, column in data.items()}

    with LogWriter.create(
        path,
        two_channels(),
        test="hysteresis",
        bench={"kind": "sim", "name": "bench"},
        configuration="a = 1\n",
        seed=5,
        chunk_rows=128,
    ) as log:
        with log.segment("sweep up", {"amplitude_rad": 0.0045, "levels": np.arange(3)}):
            log.append(rows(0, 450))
        log.append(rows(450, 550))
        with log.segment("held-out µ"):
            log.append(rows(550, 1000))
    return data


@pytest.fixture
def small_log(tmp_path: Path) -> tuple[Path, dict[str, np.ndarray]]:
    """A small log and its values."""
    path = tmp_path / "small.h5"
    return path, write_small_log(path)


@pytest.fixture
def unsealed(small_log: tuple[Path, dict[str, np.ndarray]]) -> Path:
    """The small log without its checksum, as a stranger may hand it over."""
    path, _ = small_log
    sidecar_of(path).unlink()
    return path


@pytest.fixture
def seal() -> Callable[[Path], Path]:
    """Write the checksum that belongs to a file, as somebody does who made it with another tool."""

    def write(path: Path) -> Path:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        path.with_name(path.name + ".sha256").write_text(f"{digest}  {path.name}\n")
        return path

    return write
