"""`mccd challenge score`: what the diagnoses are worth against the truth."""

from __future__ import annotations

import json
from pathlib import Path

import click

from mccdcli.options import common_options
from mccdcli.output import emit, plain, table


@click.command("score")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="DIR")
@click.option("--made-by", "commands", multiple=True, metavar="TEXT", help="Command to print on the page; repeatable.")
@click.option("--so-far", is_flag=True, help="Score the cases before the first that was not run yet.")
@click.option("--from", "first", metavar="CASE", help="Leave out the cases before this one.")
@common_options("out", "json")
def score(
    folder: Path, commands: tuple[str, ...], so_far: bool, first: str | None, out: Path | None, as_json: bool
) -> int:
    """Reveal the truth of a challenge, check its seal, and score the diagnoses.

    Writes OUT.md and OUT.json (default: score in DIR). The exit code is 0 when every measure reaches what it must on as
    many cases as the design demands, else 1.

    \b
    Examples:
      mccd challenge score DIR
      mccd challenge score DIR -o benchmarks/results/challenge
      mccd challenge score DIR --so-far
      mccd challenge score DIR --from 0278
    """
    from datetime import UTC, datetime

    from campaigns.challenge.markdown import page
    from campaigns.challenge.run import diagnosed_by
    from campaigns.challenge.score import score_challenge

    result = score_challenge(folder, so_far=so_far, first=first)
    target = out or folder / "score"
    version = diagnosed_by(folder, [one["case"] for one in result.cases])
    date = datetime.now(UTC).date().isoformat()
    result_text = json.dumps({"date": date, "version": version, **plain(result.plain())}, indent=1, allow_nan=False)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.with_suffix(".json").write_text(result_text + "\n", encoding="utf-8")
    part = f"{f' --from {first}' if first else ''}{' --so-far' * so_far}"
    made_by = commands or (f"mccd challenge run {folder}", f"mccd challenge score {folder}{part}")
    target.with_suffix(".md").write_text(page(result, date=date, commands=made_by, version=version), encoding="utf-8")
    rows = [
        (
            m.name,
            "-" if m.value is None else f"{m.value:.3g}",
            "" if m.interval is None else f"{m.interval[0]:.3g} to {m.interval[1]:.3g}",
            m.counted,
            m.must,
            {"yes": "ok", "no": "MISSED"}.get(m.mark, m.mark),
        )
        for m in result.measures
    ]
    heads = ("measure", "value", "95 % interval", "n", "must reach", "")
    emit(result.plain(), as_json=as_json, text=table(rows, heads))
    return 0 if result.ok else 1
