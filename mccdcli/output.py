"""What a command says: its result on standard output, its remarks on standard error."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TextIO
from unicodedata import category as kind_of

import click

from sim_backend.errors import MccdWarning

GOOD, BAD = "green", "red"

VERDICTS = {"The simulation is consistent": GOOD, "The simulation lacks": BAD, "The simulation is wrong": BAD}
"""How the sentence of a diagnosis begins, by colour."""


def emit(result: object, *, as_json: bool, text: str, colours: Mapping[str, str] | None = None) -> None:
    """Print the result on standard output: `result` as one JSON document, or `text` for a person to read.

    Numbers of the text have no exponents. On a terminal each of the words or phrases in `colours` has its colour,
    unless NO_COLOR is set.
    """
    if as_json:
        click.echo(json.dumps(plain(result), indent=2, allow_nan=False))
    else:
        from analysis.pages.formats import without_exponents

        text = without_exponents(text)
        click.echo(painted(visible(text), colours or {}) if in_colour(sys.stdout) else visible(text))


def in_colour(stream: TextIO) -> bool:
    """Tell whether what is written to `stream` may have colours."""
    return stream.isatty() and os.environ.get("TERM") != "dumb" and not os.environ.get("NO_COLOR")


def painted(text: str, colours: Mapping[str, str]) -> str:
    """Return `text` with each whole word or phrase of `colours` in its colour."""
    if not colours:
        return text
    longest_first = sorted(colours, key=len, reverse=True)
    phrase = re.compile(rf"(?<!\w)({'|'.join(map(re.escape, longest_first))})(?!\w)")
    return phrase.sub(lambda found: click.style(found[0], fg=colours[found[0]], bold=True), text)


def say(remark: str) -> None:
    """Print a remark on standard error, where it cannot mix with the result.

    One that a full disk does not take is lost: what was asked for is done all the same.
    """
    try:
        click.echo(visible(remark), err=True)
    except BrokenPipeError:
        raise
    except OSError:
        discard(sys.stderr)


def discard(stream: TextIO) -> None:
    """Let `stream` lead nowhere: what it still holds cannot be written, or Python complains at its exit."""
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


@contextmanager
def warnings_in_one_line() -> Iterator[None]:
    """Show warnings of ours as a remark in one line; any other as Python does, with the line that it is about."""
    usual = warnings.showwarning

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if issubclass(category, MccdWarning):
            say(f"mccd: warning: {' '.join(str(message).split())}")
        else:
            usual(message, category, filename, lineno, file, line)

    warnings.showwarning = show
    try:
        yield
    finally:
        warnings.showwarning = usual


def visible(text: str) -> str:
    """Return `text` with control and other invisible characters spelled out, line breaks and tabs left.

    A file may contain anything; it must not act on the terminal as a command to it.
    """
    return "".join(c if c in "\n\t" or kind_of(c)[0] != "C" else ascii(c)[1:-1] for c in text)


def plain(value: object) -> Any:
    """Reduce `value` to what JSON can hold.

    Dataclasses become objects by field; arrays and sequences, lists; sets, sorted lists; paths and everything
    else without a JSON type, text. JSON has no NaN and no infinity: they become null.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (set, frozenset)):
        return sorted((plain(item) for item in value), key=str)
    if hasattr(value, "tolist"):  # a numpy array or scalar, told without importing numpy
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (str, bool, int)):
        return value
    return str(value)


def table(rows: Sequence[Sequence[str]], heads: Sequence[str] = ()) -> str:
    """Set `rows` in columns, two spaces apart, the last one ragged; the `heads`, if given, above them.

    Numbers have no exponents.
    """
    from analysis.pages.formats import without_exponents

    lines = [list(map(without_exponents, line)) for line in ([heads, *rows] if heads else rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines
    )
