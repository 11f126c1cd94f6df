"""How often names were right, by the posterior that stood beside them: the table that stated probabilities come from.

    python -m benchmarks.calibrate_names SCORE.json …     print the table
    python -m benchmarks.calibrate_names --write          make analysis/diagnosis/calibration.toml again

SCORE.json is what `mccd challenge score` and `pool` write (decision 46).
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from analysis.diagnosis.calibration import TABLE

ROOT = Path(__file__).parents[1]
SCORES = (
    "benchmarks/results/second-generator-83217-2026-11-27.json",
    "benchmarks/results/second-generator-26119-2026-11-27.json",
)
"""Sealed cases of burnt seeds, simulated by another hand: listed effects, with a twist, in pairs, unlisted, none."""

LEAST = 100
"""Names that a bin holds at least: a share of fewer says little."""


def names_of(scores: Sequence[Path]) -> list[tuple[float, bool]]:
    """Return every stated posterior with whether its name was right, by rising posterior."""
    found: list[tuple[float, bool]] = []
    for path in scores:
        for case in json.loads(path.read_text(encoding="utf-8"))["cases"]:
            # scores from before the posterior was told beside the probability: they were one
            kind = "posteriors" if "posteriors" in case else "stated"
            found += zip(case[kind], case[f"{kind}_right"], strict=True)
    return sorted(found)


def bins_of(names: Sequence[tuple[float, bool]]) -> list[tuple[float, int, int]]:
    """Return (least posterior, names, right ones): bins of `LEAST` names or more in which what is right rises.

    Names of one posterior stay together.
    """
    bins: list[tuple[float, int, int]] = []
    for posterior, equal in itertools.groupby(names, key=lambda name: name[0]):
        rights = [right for _, right in equal]
        if bins and bins[-1][1] < LEAST:
            least, count, right = bins.pop()
        else:
            least, count, right = posterior, 0, 0
        bins.append((least, count + len(rights), right + sum(rights)))
    # a surer name is no worse, and what is too few to tell is one with those before it (pool adjacent violators)
    pooled: list[tuple[float, int, int]] = []
    for one in bins:
        pooled.append(one)
        while len(pooled) > 1 and (
            pooled[-1][1] < LEAST or pooled[-2][2] * pooled[-1][1] >= pooled[-1][2] * pooled[-2][1]
        ):
            (least, count, right), (_, more, also) = pooled[-2:]
            pooled[-2:] = [(least, count + more, right + also)]
    return pooled


def text_of(bins: Sequence[tuple[float, int, int]], scores: Sequence[str]) -> str:
    """Return the table as TOML."""
    head = f"# made by python -m benchmarks.calibrate_names --write, from {', '.join(scores)}\n"
    return head + "".join(f"\n[[bins]]\nleast = {a!r}\nnames = {n}\nright = {k}\n" for a, n, k in bins)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, or write it; exit code 2 when there are no names."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("scores", nargs="*", type=Path)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args(arguments)
    scores = options.scores or [ROOT / one for one in SCORES]
    names = names_of(scores)
    if not names:
        print("no names are stated in these scores; give scores with named cases", file=sys.stderr)
        return 2
    text = text_of(bins_of(names), SCORES if not options.scores else [str(s) for s in scores])
    if options.write:
        TABLE.write_text(text, encoding="utf-8")
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
