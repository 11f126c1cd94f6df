"""The table of a results file."""

from __future__ import annotations

from typing import Any

from benchmarks.speed.machine import doubt

SCHEMA = "mccd-speed/2"
_ANSWERS = {True: "yes", False: "**no**", None: "not measured"}


def markdown(found: dict[str, Any]) -> str:
    """Return the results of a run as a page of Markdown."""
    lines = [
        *_circumstances(found),
        "",
        "| work | number | must be | median (lowest to highest) | reached |",
        "|---|---|---|---|---|",
    ]
    for row in found["benchmarks"]:
        lines += [_target_line(row, target) for target in row["targets"]]
    lines += [
        "",
        "| work | contender | time per unit (median) | differs from the reference by | may differ by |",
        "|---|---|---|---|---|",
    ]
    for row in found["benchmarks"]:
        lines += _contender_lines(row)
    for row in found["benchmarks"]:
        lines += _remarks(row)
    return "\n".join(lines) + "\n"


def _circumstances(found: dict[str, Any]) -> list[str]:
    """Return with which sources, where, when and beside what else was measured, a line each."""
    mccd, machine, load = found["mccd"], found["machine"], found["load"]
    why = doubt(mccd)
    on = ", ".join(f"{name} {value}" for name, value in machine.items() if name not in ("processor", "cores"))
    at = {when: " ".join(f"{x:g}" for x in values) if values else "unknown" for when, values in load.items()}
    small = ["Small sizes (`--quick`): only whether the results agree counts, no time."] if found.get("quick") else []
    return [
        *small,
        f"mccd {mccd['version']}, commit {mccd['commit']}" + (f" (**{why}**)" if why else "") + ".",
        f"{machine['processor']}, {machine['cores']} cores; {on}.",
        f"`{found['command']}`, from {found['started_utc']} to {found['ended_utc']}; "
        f"load over 1, 5 and 15 minutes at the start {at['start']}, at the end {at['end']}.",
    ]


def _target_line(row: dict[str, Any], target: dict[str, Any]) -> str:
    return (
        f"| {row['name']} | {target['what']} | {limit_of(target)} | {measured_of(target)} "
        f"| {_ANSWERS[target['reached']]} |"
    )


def limit_of(target: dict[str, Any]) -> str:
    """Return what a target asks for."""
    return f"{'≤' if target['at_most'] else '≥'} {target['limit']:g} {target['unit']}"


def measured_of(target: dict[str, Any]) -> str:
    """Return what was measured of a target: the median over the rounds, the lowest and the highest."""
    if target["reached"] is None:
        return "–"
    return f"{_short(target['median'])} ({_short(target['lowest'])} to {_short(target['highest'])})"


def _contender_lines(row: dict[str, Any]) -> list[str]:
    lines = []
    errors = {a["name"]: a for a in row["agreements"]}
    for name, told in row["contenders"].items():
        time = f"{told['seconds_per_unit']['median']:.3g} s"
        error, allowed = (
            ("reference", "")
            if name not in errors
            else (f"{errors[name]['error']:.2g}", f"{errors[name]['allowed']:.2g}: {errors[name]['what']}")
        )
        lines.append(f"| {row['name']} | {name} | {time} | {error} | {allowed} |")
    return lines


def _remarks(row: dict[str, Any]) -> list[str]:
    facts = ", ".join([f"clock: {row['clock']}", *(f"{key} {value}" for key, value in row["facts"].items())])
    lines = ["", f"**{row['name']}**: {row['work']}" + f" ({facts})."]
    lines += [f"- {name} is absent: {why}" for name, why in row["absent"].items()]
    for target in row["targets"]:
        if target["reached"] is False:
            lines.append(f"- not reached, {target['what']}: {target.get('why', 'no reason known yet')}")
    for name, profile in row["profiles"].items():
        lines += [f"- profile of {name}:", *(f"  - {line}" for line in profile)]
    return lines


def _short(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
