"""The sealed truth of a challenge: what was hidden where, how large against its limits; its hash is written first."""

from __future__ import annotations

import hashlib
import zlib
from pathlib import Path
from typing import Literal

import msgspec

from sim_backend.errors import ConfigError, DataError
from sim_backend.safe_write import folder_within, write_bytes, write_text
from sim_backend.small_files import SIDECAR_BYTES, STATE_BYTES, read_small

Stratum = Literal["one", "faint", "two", "none", "outside", "twisted", "unlisted"]
"""What a case is: one listed effect, one near detection, a pair, nothing, one listed effect that is left out of the
search, one listed effect with a twist, or a law that no library lists."""

SEAL, TRUTH = "seal.txt", "truth/truth.bin"

MOST_BYTES = 256 * 2**20
"""A truth takes some kilobytes for each case."""


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all tables: unknown fields are errors."""


class Number(_Strict, frozen=True, kw_only=True):
    """A parameter by the library's name: its value, and the least standard deviation that any estimate can have."""

    value: float
    bound_std: float | None = None


class Buried(_Strict, frozen=True, kw_only=True):
    """One hidden effect: cause, location, parameters, size, and the limits of its size in this campaign.

    `law` is what the second generator calls it: several of its laws are one cause, an unlisted one is none.
    """

    effect: str
    where: str
    parameters: dict[str, Number]
    size: float
    detection_limit: float
    naming_limit: float
    rival: str
    twins: list[tuple[str, str]] = []
    law: str = ""


class Case(_Strict, frozen=True, kw_only=True):
    """One case: its stratum, what is hidden, and the relative error that the truth leaves held out.

    `traits` are what scores are broken down by, `granted` names that are true besides and no wrong ones; `noise_rms`
    is that of every reading, `redrawn` counts draws that were given up, by reason.
    """

    stratum: Stratum
    effects: list[Buried]
    held_out_floor: float
    shape: str
    axes: int
    traits: dict[str, str] = {}
    granted: list[tuple[str, str]] = []
    noise_rms: list[float] = []
    redrawn: dict[str, int] = {}


class Truth(_Strict, frozen=True, kw_only=True):
    """The truth of all cases by name; `salt` keeps the seal from being guessed."""

    schema: Literal["mccd-challenge-truth/1"] = "mccd-challenge-truth/1"
    seed: int
    salt: str
    cases: dict[str, Case]


def seal(folder: Path, truth: Truth) -> str:
    """Write the hash, then the truth; return the hash."""
    data = zlib.compress(msgspec.json.encode(truth), 9)
    digest = hashlib.sha256(data).hexdigest()
    write_text(folder / SEAL, f"sha256 {digest}  {TRUTH}\n")
    path = folder / TRUTH
    folder_within(folder, path.parent.name)
    write_bytes(path, data)
    return digest


def reveal(folder: Path) -> Truth:
    """Return the truth; raises ConfigError when there is none, DataError when it is not what was sealed."""
    path, promised = folder / TRUTH, sealed(folder)
    try:
        data = read_small(path, STATE_BYTES)
    except OSError as error:
        raise ConfigError(_without_truth(folder, error)) from None
    digest = hashlib.sha256(data).hexdigest()
    if promised != digest:
        raise DataError(
            f"{path} has the hash {digest[:12]}…, the seal says {promised[:12] or 'nothing'}…: "
            "the truth was changed after it was sealed; make the challenge again"
        )
    unpacker = zlib.decompressobj()
    try:
        text = unpacker.decompress(data, MOST_BYTES)
        if unpacker.unconsumed_tail:
            raise DataError(f"{path} unpacks to more than {MOST_BYTES} bytes: make the challenge again")
        return msgspec.json.decode(text, type=Truth)
    except (zlib.error, msgspec.DecodeError) as error:
        raise DataError(f"{path} does not hold a truth of this version ({error}): make the challenge again") from None


def sealed(folder: Path) -> str:
    """Return the hash that a challenge's seal promises, empty where it says none; raises ConfigError without a seal."""
    try:
        words = read_small(folder / SEAL, SIDECAR_BYTES).decode("utf-8", "replace").split()
    except OSError as error:
        raise ConfigError(_without_truth(folder, error)) from None
    return words[1] if len(words) > 1 else ""


def _without_truth(folder: Path, error: OSError) -> str:
    return f"{folder} holds no sealed truth ({SEAL} and {TRUTH}; {error.strerror}): make a challenge there first"
