"""Checks as a file of JUnit, which continuous integration shows one by one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from mccdcli.output import visible
from sim_backend.safe_write import require_new_or_own, write_text

_HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'
_BEGIN = f'{_HEAD}<testsuites>\n  <testsuite name="mccd '
"""How every file of ours begins: the name of a suite is that of a command."""


class Case(NamedTuple):
    """One check: its group, which may be empty, its name, and why it failed or was skipped; else it passed."""

    group: str
    name: str
    failure: str = ""
    skipped: str = ""


def prepare_junit(path: Path | None, out: Path) -> None:
    """Remove the file of an earlier run, before anything can fail: it would be taken for the result of this one.

    `out` is the folder that the command makes first. Raises ConfigError where something else is there, OSError
    where none can be written; both before any work.
    """
    if path is not None and (out.exists() or path.parent.resolve() != out.resolve()):
        require_new_or_own(path, lambda begin: begin.startswith(_BEGIN.encode()), "JUnit file of mccd")
        path.unlink(missing_ok=True)


def write_junit(path: Path, suite: str, cases: Sequence[Case]) -> Path:
    """Write the cases of a suite to `path`, replacing what is there, and return the path."""
    from xml.etree import ElementTree  # few ask for such a file

    counts = {
        "tests": len(cases),
        "failures": sum(bool(case.failure) for case in cases),
        "errors": 0,
        "skipped": sum(bool(case.skipped) for case in cases),
    }
    root = ElementTree.Element("testsuites")
    inside = ElementTree.SubElement(root, "testsuite", {"name": suite, **{k: str(n) for k, n in counts.items()}})
    for case in cases:
        group = f".{visible(case.group)}" if case.group else ""
        names = {"classname": f"{suite}{group}", "name": visible(case.name)}
        element = ElementTree.SubElement(inside, "testcase", names)
        for kind, why in (("failure", case.failure), ("skipped", case.skipped)):
            if why:
                ElementTree.SubElement(element, kind, {"message": visible(why)})
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return write_text(path, f"{_HEAD}{text}\n")
