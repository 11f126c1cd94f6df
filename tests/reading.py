"""Following a page of the documents: its blocks of shell and Python, run in their order."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import NamedTuple

from tests import running

DOCS = Path(__file__).parents[1] / "docs"

_BLOCK = re.compile(r"(?:<!-- (?P<mark>[^>]*?) -->\n)?```(?P<kind>sh|python)\n(?P<text>.*?)```", re.DOTALL)


class Block(NamedTuple):
    """A block of a page: its language, its text, the exit code it ends with; `left_out` says why it is not run,
    `long` that it takes minutes."""

    kind: str
    text: str
    exit_code: int
    left_out: str
    long: bool = False


def blocks(page: str) -> list[Block]:
    found = []
    for match in _BLOCK.finditer((DOCS / page).read_text(encoding="utf-8")):
        mark = match["mark"] or ""
        left_out = mark.removeprefix("not run: ") if mark.startswith("not run: ") else ""
        code = int(mark.removeprefix("exit: ")) if mark.startswith("exit: ") else 0
        found.append(Block(match["kind"], match["text"], code, left_out, mark.startswith("long: ")))
    return found


def to_run(page: str) -> list[Block]:
    return [block for block in blocks(page) if not block.left_out]


def follow(page: str, folder: Path) -> str:
    """Run every block of a page in its order and return all that it printed."""
    printed = ""
    for block in to_run(page):
        command = ["bash", "-euc", block.text] if block.kind == "sh" else [*running.PYTHON, "-c", block.text]
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=180, stdin=subprocess.DEVNULL
        )
        assert done.returncode == block.exit_code, f"{page}:\n{block.text}\n{done.stdout}\n{done.stderr}"
        printed += done.stdout
    return printed
