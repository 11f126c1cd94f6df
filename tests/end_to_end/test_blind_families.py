"""Every family blind: hidden in logs by a process of its own, diagnosed by the command, its truth opened afterwards.

The bench is the challenge's: a simulator that shares no code with the one that is fitted, nominal numbers wrong by up
to 3 %, coloured noise, small modes that no model has. What is hidden is at least twice as large as its naming limit.
Seeds, shapes and thresholds were fixed before any of these cases had been looked at.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from analysis.challenge.families import slugs
from analysis.challenge.judge import Judged, judge
from analysis.challenge.run import run_challenge
from analysis.challenge.truth import reveal
from tests import running
from tests.kept import SIMULATED, kept
from tests.selection import is_thorough

pytestmark = [pytest.mark.slow, pytest.mark.blind]

FIRST_SEED = 300
FAMILIES = {slug: FIRST_SEED + i for i, slug in enumerate(sorted(slugs()))}

FULL = {
    "broadband-vibration",  # in a few seconds even a narrow band may pass for a line
    "command-quantisation",  # in 13 000 rows a few held levels decide, and a multiple of the step fits as well
}
"""Families that are played in a full campaign (136 000 rows); all others in a short one (13 200), to save time."""


@dataclass(frozen=True)
class Miss:
    """What is said today of a case that does not come out: its verdict, the causes it names, and why."""

    verdict: str
    why: str
    causes: tuple[str, ...] = ()


NOT_YET = {
    "command-quantisation": Miss("consistent", "2.2 times a limit that knows the step, not worth the 20 000 tried"),
}
"""Families that are not named in their case yet; docs/diagnosis-limits.md lists them."""

OF_TRUTH = 1.1
"""Held-out error over that of the true structure with the true parameters: 1 % by chance, the rest is misfit."""

PAIRS = {("coulomb-friction", "position-dependent-force-constant"): 360, ("cubic-stiffness", "vibration-line"): 361}
"""Two causes at once, neither with a twin."""

PAIRS_NOT_YET = {
    ("cubic-stiffness", "vibration-line"): Miss(
        "named",
        "the line, at 3.8 times its limit on the other axis, is not found beside the spring",
        ("cubic-stiffness",),
    ),
}
"""Pairs of which not both are named yet; docs/diagnosis-limits.md lists them."""

NULL_SEEDS = (340, 341, 342)
OUTSIDE = {"coulomb-friction": 350, "periodic-torque": 351, "sensor-drift": 352}
"""Families whose cause is left out of the search; each shows itself in another way: by motion, position, time."""


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
    done = running.mccd(*arguments, timeout=400)
    assert done.returncode == 0, done.stderr


def diagnosed(folder: Path, seed: int, *what: str, drawn: bool = False) -> Said:
    """Make one case, diagnose it as a challenge does or with its page, and only then open the truth."""
    made = kept(
        f"blind-{seed}",
        lambda out: mccd("challenge", "make", str(out / "challenge"), "--seed", str(seed), *what),
        of=SIMULATED,
        recipe=" ".join(what),
    )
    shutil.copytree(made / "challenge", folder / "challenge")
    run_challenge(folder / "challenge", command=(*running.MCCD, "diagnose", "--page" if drawn else "--no-page"))
    ((name, case),) = reveal(folder / "challenge").cases.items()
    judged = judge(folder / "challenge", name, case)
    result = folder / "challenge" / "results" / name
    assert judged.verdict != "failed", (result / "words.txt").read_text(encoding="utf-8")
    assert (result / "index.html").exists() == drawn
    return Said(judged, json.loads((result / "diagnosis.json").read_text(encoding="utf-8")))


def missed_as_expected(said: Said, miss: Miss) -> None:
    """Let a known miss be one: today's verdict and causes, no other; what came out right must lose its mark."""
    causes = tuple(sorted(cause["effect"] for cause in said.content["causes"]))
    assert (said.judged.verdict, causes) == (miss.verdict, miss.causes), f"not the known miss: {said}"
    pytest.xfail(f"{miss.verdict}: {miss.why}")


def adding_it_pays(said: Said) -> None:
    """Require a held-out error near that of the truth, and a gain wherever there is one to be had."""
    gain, floor = said.content["gain"], said.judged.case.held_out_floor
    assert gain["rms_after"] <= OF_TRUTH * floor, str(said)
    # What is compared is the nominal model after re-tuning. Where that is at the floor nothing is left to gain: a shift
    # of a nominal number is re-tuned away, and another effect may leave no mark on the held-out rows (a fringe that is
    # not lost there). The gain is zero to five digits then, on either side; the line above bounds what may be lost.
    if gain["rms_before"] > OF_TRUTH * floor:
        assert gain["ci95"][0] > 0.0, str(said)


@pytest.mark.parametrize(("slug", "seed"), FAMILIES.items(), ids=FAMILIES)
def test_a_hidden_cause_is_named_and_adding_it_pays(
    slug: str, seed: int, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    shape = "full" if slug in FULL else "short"
    drawn = is_thorough(request.node.nodeid)  # in the quick run the tutorial and other pages draw what they name
    said = diagnosed(tmp_path, seed, "--family", slug, "--one", "1", "--none", "0", "--shape", shape, drawn=drawn)
    (hidden,) = said.judged.case.effects
    assert hidden.effect == slug and hidden.size >= 2.0 * hidden.naming_limit
    if slug in NOT_YET:
        assert not said.judged.right, f"named: take it out of NOT_YET; {said}"
        missed_as_expected(said, NOT_YET[slug])
    assert said.judged.right, str(said)
    adding_it_pays(said)


@pytest.mark.parametrize(("pair", "seed"), PAIRS.items(), ids=map("+".join, PAIRS))
def test_two_hidden_causes_are_named_and_adding_them_pays(pair: tuple[str, str], seed: int, tmp_path: Path) -> None:
    words = [word for slug in pair for word in ("--family", slug)]
    said = diagnosed(tmp_path, seed, *words, "--one", "0", "--none", "0", "--two", "1", "--shape", "short")
    hidden = said.judged.case.effects
    assert {e.effect for e in hidden} == set(pair)
    assert all(e.size >= 2.0 * e.naming_limit for e in hidden)
    if pair in PAIRS_NOT_YET:
        assert not said.judged.right, f"both named: take them out of PAIRS_NOT_YET; {said}"
        missed_as_expected(said, PAIRS_NOT_YET[pair])
    assert said.judged.right, str(said)
    adding_it_pays(said)


@pytest.mark.parametrize("seed", NULL_SEEDS)
def test_nothing_hidden_is_consistent(seed: int, tmp_path: Path) -> None:
    said = diagnosed(tmp_path, seed, "--one", "0", "--none", "1", "--shape", "short")
    assert said.judged.verdict == "consistent", str(said)


@pytest.mark.parametrize(("slug", "seed"), OUTSIDE.items(), ids=OUTSIDE)
def test_a_cause_that_is_left_out_of_the_search_is_unknown(slug: str, seed: int, tmp_path: Path) -> None:
    what = ("--family", slug, "--one", "0", "--none", "0", "--outside", "1", "--shape", "short")
    said = diagnosed(tmp_path, seed, *what)
    assert said.judged.verdict == "unknown", str(said)
