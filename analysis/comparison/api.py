"""From two paths to their comparison: what a file is, its content says."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from analysis.comparison.table import Comparison
from sim_backend.documents import json_of, read_text
from sim_backend.errors import ConfigError, DataError
from sim_backend.model import bundled_models, load_model
from sim_backend.small_files import STATE_BYTES

RUN_MARK: Final = b"\x89HDF\r\n\x1a\n"
DIAGNOSIS: Final = "diagnosis.json"
DIAGNOSIS_SCHEMA: Final = "mccd-diagnosis/"


class Kind(NamedTuple):
    """One kind of thing to compare: how it is known, and `module:function` beside this that compares two."""

    known: Callable[[str], bool]
    compare: str


def is_run(path: str) -> bool:
    """Tell whether a path is a file of HDF5."""
    if not Path(path).is_file():
        return False
    with open(path, "rb") as file:
        return file.read(len(RUN_MARK)) == RUN_MARK


def is_diagnosis(path: str) -> bool:
    """Tell whether a path is a folder that holds a diagnosis, or the JSON file of one.

    Raises DataError for a file of that name that cannot be read.
    """
    file = Path(path)
    if file.is_dir():
        return (file / DIAGNOSIS).is_file()
    if not file.is_file() or file.suffix.lower() != ".json":
        return False
    try:
        found = document_in(file)
    except DataError:
        if file.name == DIAGNOSIS:
            raise
        return False  # whoever else reads JSON says what is wrong
    return isinstance(found, dict) and str(found.get("schema")).startswith(DIAGNOSIS_SCHEMA)


def is_model(path: str) -> bool:
    """Tell whether a path names a model; raises ConfigError for a file of TOML or JSON that is not a valid one."""
    if path in bundled_models():
        return True
    if not Path(path).is_file() or Path(path).suffix.lower() not in (".toml", ".json"):
        return False
    load_model(path)
    return True


# A function is imported when two of its kind are there: a path that is none is refused at once.
KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {
        "run": Kind(is_run, "runs:compare_runs"),
        "diagnosis": Kind(is_diagnosis, "diagnoses:compare_diagnoses"),
        "model": Kind(is_model, "models:compare_models"),
    }
)
"""What can be compared, in the order in which a file is asked whether it is one. The only list."""


def compare(first: str, second: str) -> Comparison:
    """Return the comparison of two logs, two models (files or bundled names) or two diagnoses (folders or JSON files).

    Raises ConfigError for a path that is none of these, or two of different kinds; DataError for a log or a diagnosis
    that cannot be read.
    """
    kinds = [kind_of(first), kind_of(second)]
    if kinds[0] != kinds[1]:
        raise ConfigError(f"{first} is a {kinds[0]} and {second} a {kinds[1]}; give two of one kind")
    module, _, function = KINDS[kinds[0]].compare.partition(":")
    found: Comparison = getattr(import_module(f"analysis.comparison.{module}"), function)(first, second)
    return found


def kind_of(path: str) -> str:
    """Return which of KINDS a path is; raises ConfigError for none."""
    for name, kind in KINDS.items():
        if kind.known(path):
            return name
    what = "is none of these" if Path(path).exists() else "does not exist, nor is it a bundled model"
    raise ConfigError(
        f"{path} {what}: give logs (.h5), models (.toml, .json or a bundled name) or folders of diagnoses"
    )


def document_in(file: Path) -> Any:
    """Return the content of a JSON file; raises DataError if it is missing, too large, or no JSON."""
    text = read_text(file, "diagnosis", most_bytes=STATE_BYTES, error=DataError, fix="diagnose again")
    return json_of(text, str(file), error=DataError, fix="diagnose again")
