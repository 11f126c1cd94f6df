"""A score written down: OUT.json with everything, OUT.md to read, and a table for the terminal."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from mccdcli.output import plain, table
from sim_backend.safe_write import write_text

if TYPE_CHECKING:
    from analysis.challenge.score import Score


def written(score: Score, target: Path, made_by: Sequence[str]) -> str:
    """Write `target`.json and `target`.md, which names the commands it was `made_by`; return the measures as text."""
    from analysis.challenge.markdown import page

    date = datetime.now(UTC).date().isoformat()
    document = {"date": date, "version": score.version, **plain(score.plain())}
    target.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(document, indent=1, allow_nan=False)
    write_text(target.with_suffix(".json"), text + "\n")
    write_text(target.with_suffix(".md"), page(score, date=date, commands=made_by, version=score.version))
    rows = [
        (
            m.name,
            "-" if m.value is None else f"{m.value:.3g}",
            "" if m.interval is None else f"{m.interval[0]:.3g} to {m.interval[1]:.3g}",
            m.counted,
            m.must,
            {"yes": "ok", "no": "MISSED"}.get(m.mark, m.mark),
        )
        for m in score.measures
    ]
    return table(rows, ("measure", "value", "95 % interval", "n", "target", ""))
