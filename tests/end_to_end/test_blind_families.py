"""Every family blind: hidden in logs by a process of its own, diagnosed by the command, its truth opened afterwards.

The bench is the challenge's: a simulator that shares no code with the one that is fitted, nominal numbers wrong by up
to 3 %, coloured noise, small modes that no model has. What is hidden is at least twice as large as its naming limit.
Seeds, shapes and thresholds were fixed before any of these cases had been looked at.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from campaigns.challenge.families import slugs
from campaigns.challenge.judge import Judged, judge
from campaigns.challenge.truth import reveal

pytestmark = [pytest.mark.slow, pytest.mark.blind]

FIRST_SEED = 300
FAMILIES = {slug: FIRST_SEED + i for i, slug in enumerate(sorted(slugs()))}

FULL = {
    "broadband-vibration",  # in a few seconds even a narrow band may pass for a line
    "command-quantisation",  # in 13 000 rows a few held levels decide, and a multiple of the step fits as well
}
"""Families that are played in a full campaign (136 000 rows); all others in a short one (13 200), to save time."""

NOT_YET = {
    "command-quantisation": "unknown: at 2.2 times a limit that knows the step, not worth the 20 000 steps tried",
    "fringe-jump": "unknown: its evidence stays 2 short of the price of a cause, at 2.6 times the limit",
}
"""Families that are not named in their case yet, and what is said instead; docs/diagnosis.md lists them."""

OF_TRUTH = 1.1
"""Held-out error over that of the true structure with the true parameters: 1 % by chance, the rest is misfit."""

NULL_SEEDS = (340, 341, 342)
OUTSIDE = {"coulomb-friction": 350, "periodic-torque": 351, "sensor-drift": 352}
"""Families whose cause is left out of the search; each shows itself in another way: by motion, position, time."""

OUTSIDE_NOT_YET = {
    "coulomb-friction": "named hysteresis, of which friction is the case with one spring",
}
"""Families for which something else is named when they are left out; docs/diagnosis.md lists them."""


@dataclass(frozen=True)
class Said:
    """A diagnosis and what it is worth."""

    judged: Judged
    content: dict[str, Any]

    def __str__(self) -> str:
        truth = [(e.effect, e.where, f"{e.size / e.naming_limit:.1f} x") for e in self.judged.case.effects]
        causes = [(c["effect"], c["where"]) for c in self.content["causes"]]
        return f"{self.judged.verdict}: {causes}, tied {self.content['ambiguous']}; hidden: {truth}"


def mccd(*arguments: str) -> None:
    """Run a command to its end; anything but success is a failure of the test."""
    done = subprocess.run([sys.executable, "-m", "mccdcli", *arguments], capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr


def diagnosed(folder: Path, seed: int, *what: str) -> Said:
    """Make one case, diagnose it, and only then open the truth."""
    at = str(folder / "challenge")
    mccd("challenge", "make", at, "--seed", str(seed), *what)
    mccd("challenge", "run", at, "--jobs", "1")
    ((name, case),) = reveal(folder / "challenge").cases.items()
    judged = judge(folder / "challenge", name, case)
    result = folder / "challenge" / "results" / name
    assert judged.verdict != "failed", (result / "words.txt").read_text(encoding="utf-8")
    return Said(judged, json.loads((result / "diagnosis.json").read_text(encoding="utf-8")))


def families(seeds: dict[str, int], not_yet: dict[str, str]) -> list[object]:
    """Every family with its seed; those that do not come out yet must fail, so that none is repaired unnoticed."""
    marks = {slug: [pytest.mark.xfail(reason=reason, strict=True)] for slug, reason in not_yet.items()}
    return [pytest.param(slug, seed, id=slug, marks=marks.get(slug, [])) for slug, seed in seeds.items()]


@pytest.mark.parametrize(("slug", "seed"), families(FAMILIES, NOT_YET))
def test_a_hidden_cause_is_named_and_adding_it_pays(slug: str, seed: int, tmp_path: Path) -> None:
    shape = "full" if slug in FULL else "short"
    said = diagnosed(tmp_path, seed, "--family", slug, "--one", "1", "--none", "0", "--shape", shape)
    (hidden,) = said.judged.case.effects
    assert hidden.effect == slug and hidden.size >= 2.0 * hidden.naming_limit
    assert said.judged.right, str(said)
    gain, floor = said.content["gain"], said.judged.case.held_out_floor
    assert gain["rms_after"] <= OF_TRUTH * floor, str(said)
    if gain["rms_before"] > OF_TRUTH * floor:
        # re-tuning the nominal model alone left something to gain on these rows: it was gained, beyond chance
        assert gain["ci95"][0] > 0.0, str(said)


@pytest.mark.parametrize("seed", NULL_SEEDS)
def test_nothing_hidden_is_consistent(seed: int, tmp_path: Path) -> None:
    said = diagnosed(tmp_path, seed, "--one", "0", "--none", "1", "--shape", "short")
    assert said.judged.verdict == "consistent", str(said)


@pytest.mark.parametrize(("slug", "seed"), families(OUTSIDE, OUTSIDE_NOT_YET))
def test_a_cause_that_is_left_out_of_the_search_is_unknown(slug: str, seed: int, tmp_path: Path) -> None:
    what = ("--family", slug, "--one", "0", "--none", "0", "--outside", "1", "--shape", "short")
    said = diagnosed(tmp_path, seed, *what)
    assert said.judged.verdict == "unknown", str(said)
