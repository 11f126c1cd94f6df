"""A link in place of whatever a command is told to write is replaced or refused, never followed."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

import pytest

from benchmarks.hostile_cases import BASES, commands_of
from benchmarks.hostile_child import in_child
from benchmarks.hostile_kit import make_kit
from mccdcli.main import main as mccd

INTO_FOLDERS = (("campaign", "run"), ("report", "--campaign"), ("study", "study.toml"))
"""These write into a folder; a link to one that a user names is the folder that is meant (docs/trust.md)."""

LIMIT_S = 60
"""Far above the second or two that each of these takes."""

KEPT = "what was there before"


def _written() -> list[tuple[str, ...]]:
    """Return sound command lines, each with the file that it writes, once more with `--force` where there is that."""
    found: list[tuple[str, ...]] = []
    for base in BASES:
        options = [name for option in commands_of(base).params for name in option.opts]
        if "-o" not in options or "--dry-run" in base:
            continue
        line = base if "-o" in base else (*base, "-o", "given")
        found += [line, (*line, "--force")] if "--force" in options else [line]
    return found


@pytest.fixture(scope="module")
def kit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of small sound files of every kind."""
    folder = tmp_path_factory.mktemp("kit") / "work"
    make_kit(folder)
    return folder


@pytest.mark.parametrize("target", ["file", "folder", "nothing"])
@pytest.mark.parametrize("line", _written(), ids=" ".join)
def test_it_is_not_followed(line: tuple[str, ...], target: str, kit: Path, tmp_path: Path) -> None:
    if target == "folder" and line[:2] in INTO_FOLDERS:
        pytest.skip("a folder that the user has named, whatever leads to it")
    work, elsewhere = tmp_path / "work", tmp_path / "elsewhere"
    shutil.copytree(kit, work, symlinks=True)
    for name in ("home", "tmp", "elsewhere/folder"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("file", "folder/file"):
        (elsewhere / name).write_text(KEPT, encoding="utf-8")
    out = work / line[line.index("-o") + 1]
    _removed(out)
    out.symlink_to(elsewhere / target)

    code, said = in_child(partial(mccd, list(line)), work, LIMIT_S)

    assert code in (0, 1, 2, 4) and "Traceback" not in said, said
    there = {str(path.relative_to(elsewhere)): path for path in elsewhere.rglob("*")}
    assert sorted(there) == ["file", "folder", "folder/file"]
    assert {there[name].read_text(encoding="utf-8") for name in ("file", "folder/file")} == {KEPT}


def _removed(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
