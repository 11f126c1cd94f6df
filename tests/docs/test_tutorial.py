"""The tutorial, followed to its end."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest

from mccdcli.schema import schema_of
from tests.reading import DOCS, follow


@pytest.mark.slow
def test_the_tutorial_ends_with_the_name_of_the_hidden_effect(reader: Path) -> None:
    printed = follow("tutorial.md", reader)
    found = json.loads((reader / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
    jsonschema.validate(found, schema_of("diagnose"))
    assert [(c["effect"], c["where"]) for c in found["causes"]] == [("cubic-stiffness", "theta_x")]
    stiffness = found["causes"][0]["parameters"]["stiffness"]
    # what mystery.toml hides, within four standard deviations
    assert abs(stiffness["value"] - 2e4) < 4.0 * stiffness["std"]
    # the sentence that the page quotes is the one that was printed
    quoted = " ".join(
        line.removeprefix("> ") for line in (DOCS / "tutorial.md").read_text().splitlines() if line.startswith("> ")
    )
    assert quoted in " ".join(printed.split())
