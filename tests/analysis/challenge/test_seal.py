"""The seal: a truth that was changed, or a hash that was, does not pass unnoticed."""

from __future__ import annotations

import zlib
from pathlib import Path

import pytest

from analysis.challenge.truth import SEAL, TRUTH, Buried, Case, Number, Truth, reveal, seal
from sim_backend.errors import ConfigError, DataError

BURIED = Buried(
    effect="delay",
    where="theta_x",
    parameters={"seconds": Number(value=1e-4, bound_std=1e-6)},
    size=1e-4,
    detection_limit=1e-5,
    naming_limit=2e-5,
    rival="amplifier-lag",
    twins=[("amplifier-lag", "theta_x")],
)
TRUTH_OF_ONE = Truth(
    seed=3, salt="00", cases={"0001": Case(stratum="one", effects=[BURIED], held_out_floor=1e-3, shape="short", axes=1)}
)


def test_what_was_sealed_is_revealed(tmp_path: Path) -> None:
    digest = seal(tmp_path, TRUTH_OF_ONE)
    assert reveal(tmp_path) == TRUTH_OF_ONE
    assert digest in (tmp_path / SEAL).read_text()


def test_truth_is_not_to_be_read_by_searching_for_a_name(tmp_path: Path) -> None:
    seal(tmp_path, TRUTH_OF_ONE)
    assert b"delay" not in (tmp_path / TRUTH).read_bytes()


@pytest.mark.parametrize("place", [0, 40, -1])
def test_a_changed_byte_is_noticed(tmp_path: Path, place: int) -> None:
    seal(tmp_path, TRUTH_OF_ONE)
    data = bytearray((tmp_path / TRUTH).read_bytes())
    data[place] ^= 1
    (tmp_path / TRUTH).write_bytes(bytes(data))
    with pytest.raises(DataError, match="changed after it was sealed"):
        reveal(tmp_path)


def test_another_truth_is_noticed(tmp_path: Path) -> None:
    seal(tmp_path, TRUTH_OF_ONE)
    other = zlib.decompress((tmp_path / TRUTH).read_bytes()).replace(b"delay", b"creep")
    (tmp_path / TRUTH).write_bytes(zlib.compress(other, 9))
    with pytest.raises(DataError, match="changed after it was sealed"):
        reveal(tmp_path)


def test_a_missing_truth_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="make a challenge there first"):
        reveal(tmp_path)
