"""One score of several: a challenge may be diagnosed and scored in parts, on days and machines of their own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from analysis.challenge.judge import Judged
from analysis.challenge.rows import SCHEMA, judged_of
from analysis.challenge.score import Score, score_of
from sim_backend.documents import json_of, read_text
from sim_backend.errors import ConfigError, DataError
from sim_backend.small_files import TABLE_BYTES

_AND = " and "


def pool(paths: Sequence[Path]) -> Score:
    """Return the score of all cases in several documents of scores, in their order.

    Raises ConfigError for a case that is in two of them and for a document of several challenges, whose cases have the
    same names, DataError for a file that holds no score of this format.
    """
    judged: list[Judged] = []
    seals: dict[str, None] = {}
    seen: dict[tuple[str, str], Path] = {}
    for path in paths:
        document = _read(path)
        if _AND in document["seal"]:
            raise ConfigError(f"{path} is of several challenges already: give the scores that it was made of instead")
        seals[document["seal"]] = None
        for one in _judged(path, document):
            key = (document["seal"], one.name)
            if key in seen:
                raise ConfigError(
                    f"case {one.name} is in {seen[key]} and in {path}, and would count twice: leave one of them out"
                )
            seen[key] = path
            judged.append(one)
    return score_of(judged, _AND.join(seals))


def _read(path: Path) -> dict[str, Any]:
    text = read_text(path, "score", most_bytes=TABLE_BYTES, error=DataError)
    document = json_of(text, str(path), error=DataError, fix="give what `mccd challenge score` has written")
    form = document.get("schema") if isinstance(document, dict) else None
    if form != SCHEMA:
        raise DataError(
            f"{path} has the form {form!r}, and scores of the form '{SCHEMA}' can be pooled: score its challenge again"
        )
    for key, kind, what in (("seal", str, "text"), ("cases", list, "list")):
        if not isinstance(document.get(key), kind):
            raise DataError(f"{path} lacks '{key}', a {what}: score its challenge again")
    return dict(document)


def _judged(path: Path, document: dict[str, Any]) -> list[Judged]:
    try:
        # what a score computes with has the types that it is declared with
        return [msgspec.convert(msgspec.to_builtins(judged_of(row)), Judged) for row in document["cases"]]
    except (KeyError, TypeError, ValueError, ArithmeticError, AttributeError, msgspec.ValidationError) as error:
        raise DataError(f"{path} holds a case that cannot be read ({error!r}): score its challenge again") from None
