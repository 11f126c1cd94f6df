"""The design of the bundled linear model, with all its stages: made once, as `mccd design` makes it."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from mccdcli.main import main
from tests.kept import ANALYSED, kept

COMMAND = ("design", "--model", "design", "--unswept", "--stages", "--out", "design", "--json")


def _designed(out: Path) -> None:
    printed = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(printed):
        patch.chdir(out)
        assert main(list(COMMAND)) == 0
    (out / "printed.json").write_text(printed.getvalue(), encoding="utf-8")


def designed() -> Path:
    """Return a folder with what the command wrote in `design/` and what it printed in `printed.json`; only read it."""
    return kept("designed", _designed, of=ANALYSED, recipe=" ".join(COMMAND))
