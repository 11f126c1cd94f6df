"""Speed against peers: ratios measured in one run, and the proof that all computed the same.

    python -m benchmarks [NAME …] [--quick] [--rounds N] [--out DIR] [--list]
    python -m benchmarks --page RESULTS.json …

Nothing is installed: peers that are absent are left out and named (`pip install 'mccd[peers]'`, pinned in
constraints.txt). Writes speed-DATE.json and speed-DATE.md, with the names of the benchmarks unless all are run.
Exit code 1 when results differ by more than they may, or a target is not reached; --quick asks only for the former.
With --page nothing is measured: the table of docs/speed.md is made from results files.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

# one core for everybody, also in the linear algebra: set before it is loaded
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.pages import TABLES  # noqa: E402
from benchmarks.pages.marks import RESULTS, with_table  # noqa: E402
from benchmarks.speed import BENCHMARKS  # noqa: E402
from benchmarks.speed.base import Benchmark  # noqa: E402
from benchmarks.speed.machine import doubt, load, machine, sources  # noqa: E402
from benchmarks.speed.measure import measure  # noqa: E402
from benchmarks.speed.report import SCHEMA, markdown  # noqa: E402

SPEED = next(table for table in TABLES if table.name == "speed")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is asked for, write and print the table; see the module for the exit codes."""
    options = _parsed(arguments)
    if options.list:
        print("\n".join(f"{b.name}: {b.work}" for b in BENCHMARKS))
        return 0
    if options.page:
        page = SPEED.page.read_text(encoding="utf-8")
        SPEED.page.write_text(with_table(page, SPEED, options.page), encoding="utf-8")
        return 0
    chosen = [b for b in BENCHMARKS if not options.names or b.name in options.names]
    found = _measured(chosen, options.rounds or (1 if options.quick else 7), options.quick)
    found["command"] = " ".join(["python -m benchmarks", *(sys.argv[1:] if arguments is None else arguments)])
    name = options.name or "-".join(["speed", *options.names, *(["quick"] if options.quick else [])])
    _write(found, options.out, f"{name}-{found['started_utc'][:10]}")
    rows = found["benchmarks"]
    agreed = all(a["holds"] for row in rows for a in row["agreements"])
    reached = all(target["reached"] is not False for row in rows for target in row["targets"])
    return 0 if agreed and (reached or options.quick) else 1


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [b.name for b in BENCHMARKS]
    parser.add_argument("names", nargs="*", metavar="NAME", help="benchmarks to run, all if none: " + ", ".join(names))
    parser.add_argument("--quick", action="store_true", help="small sizes, one round: only the results count")
    parser.add_argument("--rounds", type=int, help="rounds of each benchmark (default: 7, with --quick 1)")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the results")
    parser.add_argument("--name", help="first part of the files' names (default: speed and the chosen benchmarks)")
    parser.add_argument("--list", action="store_true", help="show the benchmarks and end")
    parser.add_argument(
        "--page", nargs="+", type=Path, metavar="FILE", help="make the table of docs/speed.md from these results"
    )
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.names) - set(names))
    if unknown:
        parser.error(f"there is no benchmark '{unknown[0]}'; benchmarks: {', '.join(names)}")
    if options.rounds is not None and options.rounds < 1:
        parser.error(f"--rounds is {options.rounds}; it needs at least 1")
    if any(not file.is_file() or file.resolve().parent != RESULTS.resolve() for file in options.page or ()):
        parser.error(f"--page takes files of {RESULTS}, for the page links to them")
    return options


def _measured(chosen: Sequence[Benchmark], rounds: int, quick: bool) -> dict[str, Any]:
    """Return all that is known after a run of these benchmarks but for the command."""
    started, measured, busy = datetime.now(UTC), sources(), load()
    if (why := doubt(measured)) is not None:
        print(f"warning: {why}; the results say so", file=sys.stderr)
    rows = []
    for benchmark in chosen:
        print(f"{benchmark.name} …", file=sys.stderr, flush=True)
        rows.append(measure(benchmark, rounds, quick))
    return {
        "schema": SCHEMA,
        "mccd": measured,
        "machine": machine(),
        "load": {"start": busy, "end": load()},
        "started_utc": started.isoformat(timespec="seconds"),
        "ended_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "quick": quick,
        "benchmarks": rows,
    }


def _write(found: dict[str, Any], folder: Path, name: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.json"
    path.write_text(json.dumps(found, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    table = markdown(found)
    path.with_suffix(".md").write_text(table, encoding="utf-8")
    print(table)
    print(f"written: {path}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
