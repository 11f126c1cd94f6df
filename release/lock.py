"""Pin every dependency, with the digests of all its files, and tell when the pins are not those of pyproject.toml.

`python release/lock.py` writes the files anew (it needs uv and the registry that pip is set up for), for every Python
and system that the project runs on; versions that fit stay. `python release/lock.py --check` needs neither.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SET_UP = ("dev", "docs", "cluster")
"""Extras that `make` installs."""

APART = ("peers-diagnosis",)
"""Extras that ask for an older numpy than the others."""

LOCKS = {
    "constraints.txt": "Every dependency, direct or not, of mccd and its extras but `peers-diagnosis`.",
    "requirements.txt": "What `make` sets up: mccd's dependencies and its extras `dev`, `docs` and `cluster`.",
    "requirements-run.txt": "What a release needs to be built and to run: mccd's dependencies without extras.",
    "constraints-peers-diagnosis.txt": "Every dependency of mccd with the extras `dev` and `peers-diagnosis`.",
}


def extras_of(lock: str) -> list[str]:
    """Return the extras whose dependencies stand in a file."""
    known = list(settings()["project"]["optional-dependencies"])
    chosen = {
        "requirements.txt": SET_UP,
        "requirements-run.txt": (),
        "constraints-peers-diagnosis.txt": ("dev", *APART),
    }
    return list(chosen.get(lock, [name for name in known if name not in APART]))


def settings() -> dict:
    """Return the content of pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def head(lock: str) -> str:
    """Return the first lines of a file: what it holds, and the digest of the dependencies that it was made for."""
    project = settings()["project"]
    declared = {
        "built by": settings()["build-system"]["requires"],
        "python": project["requires-python"],
        "needed": project["dependencies"],
        "extras": {name: project["optional-dependencies"][name] for name in extras_of(lock)},
    }
    digest = hashlib.sha256(json.dumps(declared, sort_keys=True).encode()).hexdigest()
    return f"# {LOCKS[lock]} Made by `make lock`; do not edit.\n# sha256 of what pyproject.toml asks for: {digest}\n"


def check() -> list[str]:
    """Return the files that were not made for what pyproject.toml asks for now."""
    return [lock for lock in LOCKS if not (ROOT / lock).read_text(encoding="utf-8").startswith(head(lock))]


def write(lock: str) -> None:
    """Write a file anew; what is needed without all extras has the versions that it has with them."""
    wanted = [f"--extra={name}" for name in extras_of(lock)]
    wanted += [] if lock.startswith("constraints") else ["--constraint=constraints.txt"]
    form = ("--universal", "--generate-hashes", "--no-header", "--no-annotate", "--no-emit-index-url", "--quiet")
    python = settings()["project"]["requires-python"].removeprefix(">=")
    command = ("uv", "pip", "compile", "pyproject.toml", "-", *form, f"--python-version={python}", *wanted)
    subprocess.run(
        [sys.executable, "-m", *command, f"--output-file={lock}"],
        input="\n".join(settings()["build-system"]["requires"]),
        text=True,
        cwd=ROOT,
        env=os.environ | registry(),
        check=True,
        stdout=subprocess.DEVNULL,
    )
    path = ROOT / lock
    path.write_text(head(lock) + path.read_text(encoding="utf-8"), encoding="utf-8")


def registry() -> dict[str, str]:
    """Return the variables that lead uv where pip is set up to fetch from."""
    asked = [sys.executable, "-m", "pip", "config", "get", "global.index-url"]
    found = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip()
    url = os.environ.get("PIP_INDEX_URL", found)
    return {"UV_DEFAULT_INDEX": url} if url else {}


def main() -> int:
    """Write the files, or with --check compare them; return the exit code."""
    if sys.argv[1:] == ["--check"]:
        stale = check()
        for lock in stale:
            print(f"{lock} was made for other dependencies than pyproject.toml has: run `make lock`", file=sys.stderr)
        return 1 if stale else 0
    for lock in LOCKS:
        write(lock)
    return 0


if __name__ == "__main__":
    sys.exit(main())
