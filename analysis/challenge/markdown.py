"""The score as a page of Markdown, dated, with the command that makes it."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.challenge.breakdown import Group
from analysis.challenge.measures import Measure
from analysis.challenge.score import FamilyScore, Score


def page(score: Score, *, date: str, commands: Sequence[str], version: str) -> str:
    """Return the score as Markdown: measures, families, and the cases that went wrong.

    A case with an effect below its naming limit is among these only where it has a wrong name.
    """
    parts = [
        f"# Blind challenge, {date}",
        f"mccd {version}, {len(score.cases)} cases, truth sealed as `{score.seal}`. Intervals are of 95 %. Made by:",
        "```\n" + "\n".join(commands) + "\n```",
        _table(
            ("measure", "value", "interval", "n", "target", ""),
            [_measure(m) for m in score.measures],
        ),
        *([f"Fewer cases than the design demands: {', '.join(score.too_few)}."] if score.too_few else []),
        "## Families",
        _table(
            ("family", "right", "interval", "wrong names", "left out: unknown", "detection / bound", "said"),
            [_family(f) for f in score.families],
        ),
        *_broken_down(score),
        "## Cases that were not right",
        _table(
            ("case", "stratum", "campaign", "hidden", "verdict", "wrong names"),
            [_case(c) for c in score.cases if c["wrong"] or not (c["right"] or c["stratum"] == "faint")],
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _broken_down(score: Score) -> list[str]:
    """Return the tables of the second generator's laws and traits and of stated probabilities, where there are any."""
    heads = ("right", "interval", "wrong names", "said")
    parts: list[str] = []
    if score.reliability:
        rows = [
            (f"{b.low:g} to {b.high:g}", f"{b.stated:.4f}", str(b.n), f"{b.right / b.n:.3g}", _interval(b.interval))
            for b in score.reliability
        ]
        table = _table(("stated", "mean", "names", "share that is right", "interval"), rows)
        parts += ["## Stated probability and how often names are right", table]
    if score.laws:
        parts += ["## Laws", _table(("stratum", "law", *heads), [_group(g) for g in score.laws])]
    if score.traits:
        parts += ["## Traits", _table(("trait", "value", *heads), [_group(g) for g in score.traits])]
    return parts


def _group(g: Group) -> tuple[str, ...]:
    said = ", ".join(f"{name} {n}" for name, n in sorted(g.said.items(), key=lambda item: -item[1]))
    return (g.kind, g.name, f"{g.right}/{g.n}", _interval(g.interval), str(g.wrong), said)


def _interval(interval: tuple[float, float]) -> str:
    return f"{interval[0]:.2f} – {interval[1]:.2f}"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return "None."
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _measure(m: Measure) -> tuple[str, ...]:
    mark = f"**{m.mark}**" if m.mark in ("no", "too few") else m.mark
    interval = "" if m.interval is None else f"{m.interval[0]:.3g} – {m.interval[1]:.3g}"
    return (m.name.strip(), "–" if m.value is None else f"{m.value:.3g}", interval, m.counted, m.must, mark)


def _family(f: FamilyScore) -> tuple[str, ...]:
    said = ", ".join(f"{name} {n}" for name, n in sorted(f.said.items(), key=lambda item: -item[1]))
    ratio = "–" if f.limit_ratio is None else f"{f.limit_ratio:.2f}"
    interval = f"{f.interval[0]:.2f} – {f.interval[1]:.2f}" if f.n else ""
    return (f.family, f"{f.found}/{f.n}", interval, str(f.wrong), f"{f.unknown}/{f.outside}", ratio, said)


def _case(c: dict[str, object]) -> tuple[str, ...]:
    hidden = ", ".join(
        f"{h['law'] or h['effect']} at {h['where']} ({h['times_naming']:.1f} × naming limit)"
        for h in c["hidden"]  # type: ignore[attr-defined]
    )
    wrong = ", ".join(" at ".join(key) for key in c["wrong"])  # type: ignore[attr-defined]
    return (str(c["case"]), str(c["stratum"]), f"{c['shape']}, {c['axes']} axes", hidden, str(c["verdict"]), wrong)
