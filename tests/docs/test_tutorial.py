"""The tutorial, followed to its end."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from analysis.pages.formats import fit_percent
from mccdcli.schema import schema_of
from sim_backend.axis_names import with_axes
from tests import headless
from tests.docs.held_spring import relative_error
from tests.reading import DOCS, follow


@pytest.mark.slow
def test_the_tutorial_ends_with_the_name_of_the_hidden_effect(reader: Path) -> None:
    printed = follow("tutorial.md", reader)
    found = json.loads((reader / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
    jsonschema.validate(found, schema_of("diagnose"))
    assert [(c["effect"], c["where"]) for c in found["causes"]] == [("cubic-stiffness", "theta_x")]
    stiffness = found["causes"][0]["parameters"]["stiffness"]
    # the simulated mirror takes one step per sample of 0.1 ms, the fit at least four: a sixteenth of the error. At 6
    # mrad the spring of 11.2 N m/rad is 3/4 · 2·10⁴ · (6 mrad)² stiffer to the fundamental. Then, four times the noise
    steps = relative_error(29.6, 1e-4, stiffening=0.75 * 2e4 * 6e-3**2 / 11.2)
    assert abs(stiffness["value"] - 2e4) < steps * 2e4 + 4.0 * stiffness["std"]
    # the page's digit
    assert stiffness["std"] < 0.5
    # no model gets below the noise: the right one is at it, but for the scatter of its estimate (a tenth is generous)
    assert found["gain"]["noise_floor"] < 1.1 * found["gain"]["rms_after"]
    # the sentence that the page quotes is the one that was printed
    quoted = " ".join(
        line.removeprefix("> ") for line in (DOCS / "tutorial.md").read_text().splitlines() if line.startswith("> ")
    )
    assert quoted in " ".join(printed.split())
    if headless.installed() is not None:
        check_page(reader / "diagnosis" / "index.html", found)


def check_page(path: Path, found: dict[str, Any]) -> None:
    """Open the page in a browser: no errors, no requests, no sideways scrolling, and what the JSON says."""
    with headless.browser() as tab:
        for width in (1280, 390):
            tab.open(path, width=width)
            assert tab.complaints() == [] and tab.requests() == [path.resolve().as_uri()]
            assert tab.run("document.documentElement.scrollWidth") <= width
        assert tab.run("document.querySelector('.lead').textContent") == with_axes(found["sentence"])
        assert tab.run("document.querySelector('.verdict').textContent") == found["verdict"]
        tiles = tab.run("[...document.querySelectorAll('.tiles data')].map(e => [Number(e.value), e.textContent])")
        gain = found["gain"]
        assert tiles == [[gain[name], fit_percent(gain[name])] for name in ("rms_given", "rms_before", "rms_after")]
        for figure in ("measured-and-simulated", "bode", "mechanism"):
            assert tab.run(f"document.querySelector('#{figure} svg') !== null"), figure
