"""Whether an input answers the output, as in a closed loop: then the noise of the output is in the input as well.

The innovation of the output at a sample cannot be predicted by later inputs, unless these answer it. So the output is
regressed on its own past and the inputs up to now, and tested for the part that later inputs explain (C. Sims,
"Money, income, and causality", 1972; with the output's own past, J. Geweke, R. Meese and W. Dent, 1983). Of a periodic
excitation, which is known for all time, only the differences from period to period are tested.

With its reference logged, the input of the same sample is tested as well: a controller that answers within its sample
puts all of a reading's noise there. Without a reference that cannot be distinguished from a plant that acts at once.

What a model misses of its inputs is found in later inputs too, but as much in inputs farther past: these are tested as
well, and must explain much less. An input that can be predicted from its past, such as a sweep, is not tested.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from campaigns.facts.base import Array, Fact, Seen
from campaigns.facts.clock import NAME as CLOCK
from campaigns.facts.regression import AHEAD, FRESH, Regression, regression_of
from campaigns.facts.stretches import Stretch

NAME = "closed-loop"

CHANCE = 1e-6
"""Chance at which inputs to come hold so much of an output that they do not answer."""

LEAST_SHARE = 0.02
"""Part of what is new in the output that the inputs to come hold at least: less biases a fit by less than that."""

RATIO = 3.0
"""By how much more they hold than the inputs farther past do."""

LEAST_LEFT = 1e-9
"""Part of what is new in an output that rounding may leave of it."""

ROUNDING = 1e-9
"""Part of an input's power below which what its references leave of it may be rounding."""

EXACT = 1e-9
"""What an input may differ by from period to period, against its size, by rounding."""


@dataclass(frozen=True)
class Answer:
    """What inputs to come hold of what is new in an output, `share`, and inputs farther `before` the order do.

    `chance` is that of so much in an open loop, `always` tells whether each half of the record shows it.
    """

    output: str
    share: float
    chance: float
    before: float
    rows: float
    always: bool = True

    @property
    def found(self) -> bool:
        """Whether the inputs answer the output: seen, throughout the record, and more than a short model leaves."""
        return self.always and self.seen and self.beyond_the_past

    @property
    def seen(self) -> bool:
        """Whether the inputs to come hold more of the output than chance and more than matters."""
        return self.chance < CHANCE and self.share > LEAST_SHARE

    @property
    def beyond_the_past(self) -> bool:
        """Whether they tell much more of it than inputs farther past: both by the logarithm of what they leave."""
        left, left_before = (max(1.0 - share, LEAST_LEFT) for share in (self.share, self.before))
        return math.log(left) < RATIO * math.log(left_before)


def facts(seen: Seen, stretches: Sequence[Stretch], known: Sequence[Fact]) -> list[Fact]:
    """Return whether the inputs answer the outputs."""
    if not stretches:
        return []
    if any(fact.name == CLOCK and fact.numbers["found"] for fact in known):
        text = "whether the inputs answer the outputs is not known: their clocks differ"
        return [Fact(NAME, text, remark=False)]
    periodic = all(s.periods >= 2 for s in stretches)
    varying = [_without_mean_period(s) for s in stretches] if periodic else list(stretches)
    if periodic and not any(np.any(s.inputs) for s in varying):
        if any(np.any(s.outputs) for s in varying):
            text = "the inputs repeat exactly while the outputs do not: they answer nothing"
            return [Fact(NAME, text, numbers={"found": 0}, remark=False)]
        return []
    worth = min(1.0 - 1.0 / s.periods for s in stretches) if periodic else 1.0
    # what references leave of an input is small in any loop
    least = ROUNDING if seen.of_role("reference") else FRESH
    answers = []
    for o, name in enumerate(seen.of_role("output")):
        regression = regression_of(varying, o, worth=worth)
        if regression is not None and regression.fresh() > least:
            answer = _answer(name, regression)
            answers.append(replace(answer, always=answer.found and _in_both_halves(varying, o, worth)))
    return [said(answers, bool(seen.of_role("reference")))]


def _in_both_halves(stretches: Sequence[Stretch], o: int, worth: float) -> bool:
    """Tell whether each half of all stretches holds it by itself: what is not linear varies with what is played."""
    for half in (0, 1):
        part = []
        for s in stretches:
            rows = slice(half * s.rows // 2, (half + 1) * s.rows // 2)
            part.append(replace(s, inputs=s.inputs[rows], outputs=s.outputs[rows], references=s.references[rows]))
        regression = regression_of(part, o, worth=worth)
        if regression is not None:
            answer = _answer("", regression)
            if answer.share < LEAST_SHARE or not answer.beyond_the_past:
                return False
    return True


def _answer(output: str, regression: Regression) -> Answer:
    """Return what the inputs to come hold of one output, beyond all that came before and the references."""
    beside = regression.of <= -2
    # given its references, an input has nothing of its own in an open loop
    now = (regression.of >= 0) & (regression.lag == 0) & bool(beside.any())
    coming = regression.after | now
    groups = [regression.past & ~now, beside, regression.before, coming]
    _, plain, before, after = regression.left(groups)
    tests = int(coming.sum())
    free = regression.rows - sum(int(group.sum()) for group in groups)
    if free <= tests or not after > 0.0:
        return Answer(output, 0.0, 1.0, 0.0, regression.rows)
    ratio = (before - after) / tests / (after / free)
    chance = float(scipy.special.fdtrc(tests, free, max(ratio, 0.0)))
    # of so many numbers, that many parts of the samples are held by chance
    share = (before - after) / before - tests / regression.rows
    return Answer(output, share, chance, (plain - before) / plain - tests / regression.rows, regression.rows)


def said(answers: Sequence[Answer], with_references: bool) -> Fact:
    """Return the fact that these answers, one for each output that could be asked, come to."""
    if not answers:
        text = "whether the inputs react to the outputs is not known: too few samples, or inputs without new content"
        return Fact(NAME, text, remark=False)
    worst = max(answers, key=lambda a: (a.found, a.share))
    numbers = {"found": int(worst.found), "share": worst.share, "samples": worst.rows}
    if not worst.found and worst.seen:
        text = (
            f"whether the inputs react to the outputs is not known: the next {AHEAD} inputs contain "
            f"{100.0 * worst.share:.0f} % of the unpredictable part of {worst.output}, but "
            + ("not throughout" if worst.beyond_the_past else "inputs farther past hold of it as well")
        )
        return Fact(NAME, text, "what is not linear, or lasts longer than the order, does that too", worst.output)
    if not worst.found:
        text = (
            f"no sign of it: the next {AHEAD} inputs contain {max(100.0 * worst.share, 0.0):.1f} % of the "
            f"unpredictable part of {worst.output}; from {100.0 * LEAST_SHARE:.0f} % on it would be seen"
        )
        unseen = "" if with_references else ", or answers within a sample without its reference in the log,"
        return Fact(
            NAME,
            text,
            f"a loop that moves the input less than that{unseen} is not seen",
            worst.output,
            "",
            numbers,
            remark=False,
        )
    names = ", ".join(a.output for a in answers if a.found)
    return Fact(
        NAME,
        f"the inputs react to {names} (closed loop): later inputs contain {100.0 * worst.share:.0f} % of its "
        "unpredictable part",
        "measured noise is in the input too, which biases averaged spectra and any path without a delay"
        + ("" if with_references else "; log the reference as well"),
        worst.output,
        numbers=numbers,
    )


def _without_mean_period(s: Stretch) -> Stretch:
    """Return whole periods without the mean over them, without the first of three or more; rounding is zero."""

    def varying(values: Array) -> Array:
        n = s.periods * s.period
        blocks = values[:n].reshape(s.periods, s.period, -1)
        blocks = blocks[1:] if s.periods >= 3 else blocks
        off = (blocks - blocks.mean(axis=0)).reshape(blocks.shape[0] * s.period, values.shape[1])
        size = np.abs(values).max(axis=0, initial=0.0)
        return np.where(np.abs(off).max(axis=0, initial=0.0) > EXACT * size, off, 0.0)

    return replace(
        s,
        inputs=varying(s.inputs),
        outputs=varying(s.outputs),
        references=varying(s.references),
        period=0,
    )
