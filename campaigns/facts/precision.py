"""How finely the source of an import keeps its numbers, which the samples of a log alone do not tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from campaigns.facts.base import Fact, Seen
from campaigns.facts.steps import LARGE

NAME = "precision"


@dataclass(frozen=True)
class Precision:
    """Significant binary places (`bits`) of a stored number, or decimal places (`digits`) of one in a text.

    `whole` numbers count in steps, which the samples show (see `steps`). `largest` is the largest magnitude in SI.
    """

    bits: int = 0
    digits: int = 0
    whole: bool = False
    largest: float = 0.0

    @property
    def rounding(self) -> float:
        """Largest rounding in SI: half of the last place of the largest number; 0 for whole numbers."""
        if self.whole:
            return 0.0
        return self.largest * (2.0**-self.bits if self.bits else 0.5 * 10.0 ** (1 - self.digits))


def coarsest(among: Sequence[Precision | None]) -> Precision | None:
    """Return the one with the largest rounding, None where one is not known."""
    known = [one for one in among if one is not None]
    return max(known, key=lambda one: one.rounding) if len(known) == len(among) else None


def facts(seen: Seen, kept: Mapping[str, Precision | None]) -> list[Fact]:
    """Return how finely each channel was kept by its source, with a remark where that is part of an output's noise."""
    found = []
    for name, precision in kept.items():
        if precision is None:
            continue
        rms = float(seen.columns[name].std())
        share = precision.rounding / rms if rms else 0.0
        large = share > LARGE and seen.channels[name].role == "output"
        numbers = {"bits": precision.bits} if precision.bits else {"digits": precision.digits}
        found.append(
            Fact(
                NAME,
                f"{name} was {_words(precision)}" + (f", rounded to {share:.2g} of its rms" if share else ""),
                "rounding is part of its noise: subtract its offset before it is stored, or store more digits"
                if large
                else "",
                name,
                numbers=numbers if precision.whole else numbers | {"share": share},
                remark=large,
            )
        )
    return found


def _words(precision: Precision) -> str:
    if precision.whole:
        return f"stored as whole numbers of {precision.bits} bits" if precision.bits else "written in whole numbers"
    return (
        f"stored with {precision.bits} significant bits"
        if precision.bits
        else f"written with {precision.digits} significant digits"
    )
