"""What takes long to make and many tests use: made once, and kept until a source that decides on it changes."""

from __future__ import annotations

import fcntl
import shutil
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / ".pytest_cache" / "kept"

SIMULATED = ("sim_backend", "campaigns")
"""Packages that decide on what a bench plays and logs hold."""

ANALYSED = (*SIMULATED, "analysis", "mccdcli")
"""Packages that decide on what is made of logs."""


def kept(name: str, make: Callable[[Path], None], *, of: tuple[str, ...], recipe: str) -> Path:
    """Return the folder that `make` filled, now or in an earlier run.

    It is made again when a file of the packages `of`, a pinned version or the `recipe` has changed; the recipe is text
    that says what `make` does, or its file's. Tests only read the folder; those that write take a copy.
    """
    stamp = sha256(f"{_digest(of)} {recipe}".encode()).hexdigest()[:16]
    FOLDER.mkdir(parents=True, exist_ok=True)
    whole = FOLDER / f"{name}-{stamp}"
    with open(FOLDER / f"{name}.lock", "w") as lock:  # another worker may need the same
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not whole.exists():
            for old in FOLDER.glob(f"{name}-{'?' * len(stamp)}*"):
                shutil.rmtree(old)
            part = whole.with_name(f"{whole.name}.part")
            part.mkdir()
            make(part)
            part.rename(whole)
    return whole


@cache
def _digest(packages: tuple[str, ...]) -> str:
    total = sha256((ROOT / "constraints.txt").read_bytes())
    for package in packages:
        for path in sorted((ROOT / package).rglob("*")):
            if path.suffix in (".py", ".toml", ".j2", ".js", ".css"):
                total.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return total.hexdigest()
