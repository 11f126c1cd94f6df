"""Write known records in random forms, dialects, units and clocks, import them, and count what came of it.

    python -m benchmarks.soak_imports --cases 10000

hypothesis draws the records (`drawn_records`), the library of each form writes them (`drawn_files`). A record must come
back in SI to one rounding. One without a flaw must be read, one with a flaw that changes numbers must be refused in one
line. Readers are forked instead of started (`forked`). Exit code 1 and the smallest case if one breaks that.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any
from unittest.mock import patch

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings

from benchmarks.drawn_files import Selections, write
from benchmarks.drawn_records import FLAWS, FORMS, REFUSED, TEXT, Record, meant, records
from benchmarks.forked import forked
from campaigns.importing import ImportReport, engine, import_run, isolated
from campaigns.log import read_run
from campaigns.log.units import UNITS
from campaigns.version import tool_commit
from sim_backend.errors import ConfigError, DataError

INTERPOLATED = 1e-9
"""Error of a linear or cubic interpolation at the readings themselves, against the largest of them: their stamps carry
the rounding of a double, 1e-12 of a sample period here."""

NO_FLAW = "none"
BROKEN = "broken"

UNHURRIED: dict[str, Any] = {
    "deadline": None,
    "database": None,
    "suppress_health_check": list(HealthCheck),
    "report_multiple_bugs": False,
}


def map_of(record: Record, source: str, selected: Selections) -> str:
    """Return the map that is right for the record."""
    lines = ["[log]", 'test = "drawn"', f'source = "{source}"']
    unit = [f'time_unit = "{record.clock}"'] if record.told == "map" and record.clock not in ("rate", "date") else []
    if record.form == "archive":
        lines += [f"sample_rate_hz = {record.rate_hz}", f'resample = "{record.resample}"', *unit]
        lines.append(f'archive = {{ time = {json.dumps(selected["time"])}, name = "pv", value = "value" }}')
    elif record.clock == "rate":
        lines.append(f"sample_rate_hz = {record.rate_hz}")
    else:
        lines += [f"time = {json.dumps(selected['time'], ensure_ascii=False)}", *unit]
    for channel, role, symbol in zip("uy", ("input", "output"), record.units, strict=True):
        lines += [f"[channels.{channel}]", f"select = {json.dumps(selected[channel], ensure_ascii=False)}"]
        lines += [f'unit = "{symbol}"', f'role = "{role}"', f"scale = {record.scale}"]
    return "\n".join(lines) + "\n"


def outcome(record: Record) -> str:
    """Import the record and return `read` or `refused`; fails where what was read is not what was written.

    A record without a flaw must be read, one with a flaw of `REFUSED` refused, in one line that names the file.
    """
    with TemporaryDirectory() as name:
        folder = Path(name)
        source, selected = write(folder, record)
        (folder / "map.toml").write_text(map_of(record, source, selected), encoding="utf-8")
        try:
            made = import_run(folder / "map.toml", folder / "out.h5")
        except (DataError, ConfigError) as error:
            assert record.flaw is not None, f"{record.form}, {record.layout} is refused: {error}"
            _check_refusal(record, str(error), folder / source)
            assert not (folder / "out.h5").exists()
            return "refused"
        assert record.flaw not in REFUSED, f"read over the flaw '{record.flaw}' of {record.form}, {record.layout}"
        _check(record, made, folder / "out.h5")
    return "read"


def _check(record: Record, made: ImportReport, path: Path) -> None:
    assert made.rows == record.rows
    assert abs(made.sample_rate_hz / record.rate_hz - 1.0) < 1e-6
    if record.clock != "date":
        late_s = 0.0 if record.clock == "rate" else record.late_s
        assert abs(made.channels[0].t0_s - late_s) < 1e-6 / record.rate_hz
    drawn = record.form == "archive" and record.resample != "hold"
    with read_run(path) as run:
        for k, channel in enumerate("uy"):
            unit = UNITS[record.units[k]]
            wanted = meant(record, k) * (record.scale * unit.factor) + unit.offset
            assert run.channels[channel].unit == unit.si
            most = INTERPOLATED * float(np.abs(wanted).max()) if drawn else 0.0
            np.testing.assert_allclose(run.read(channel), wanted, rtol=1e-15, atol=most)


def _check_refusal(record: Record, said: str, source: Path) -> None:
    """Check that a refusal is one line that names the map, and the file or line of what is flawed."""
    assert "\n" not in said and "map.toml" in said, said
    if record.flaw in ("missing", "other unit"):
        assert source.name in said, said
    if record.form in TEXT and record.flaw in ("missing", "short"):
        lines = source.read_bytes().decode(str(record.style["encoding"])).split(str(record.style["newline"]))
        assert f"line {len(lines) - record.rows + record.at}" in said, said


def count(cases: int, start: int = 0, forms: tuple[str, ...] = FORMS) -> dict[str, Counter[str]]:
    """Draw `cases` records of each form and return how many of each were `read` and `refused`, by their flaw.

    Raises AssertionError with the smallest one that is read wrong, refused without a flaw, or read over one.
    """
    found: dict[str, Counter[str]] = {form: Counter() for form in forms}
    for form in forms:
        _count(form, cases, start, found[form])
    return found


def _count(form: str, cases: int, start: int, tally: Counter[str]) -> None:
    @seed(len(FORMS) * start + FORMS.index(form))
    @settings(max_examples=cases, phases=(Phase.generate, Phase.shrink), **UNHURRIED)
    @given(records((form,)))
    def each(record: Record) -> None:
        tally[f"{outcome(record)}: {record.flaw or NO_FLAW}"] += 1

    each()


def page(found: Mapping[str, Counter[str]], seconds: float) -> str:
    """Return the result as the page that is kept; the count of a form ends with its first broken promise."""
    total = sum(found.values(), Counter[str]())
    lines = [
        f"# Drawn records, {datetime.now(UTC):%Y-%m-%d}",
        "",
        f"Commit {tool_commit()}, Python {platform.python_version()}, {os.cpu_count()} cores, {seconds:.0f} s. "
        f"`python -m benchmarks.soak_imports {' '.join(sys.argv[1:])}`",
        "",
        "A record without a flaw must be read, and every number must be equal to one rounding; one with a flaw must be "
        "refused.",
        "",
        "| form | cases | read, equal | refused for its flaw | broken promises |",
        "|---|---|---|---|---|",
    ]
    for form, tally in (*found.items(), ("**all**", total)):
        read, refused = (_of(tally, f"{what}: ") for what in ("read", "refused"))
        lines.append(f"| {form} | {tally.total():,} | {read:,} | {refused:,} | **{tally[BROKEN]}** |")
    lines += ["", "| flaw | read, equal | refused |", "|---|---|---|"]
    lines += [f"| {flaw} | {total[f'read: {flaw}']:,} | {total[f'refused: {flaw}']:,} |" for flaw in (NO_FLAW, *FLAWS)]
    return "\n".join(lines) + "\n"


def _of(tally: Counter[str], start: str) -> int:
    return sum(number for key, number in tally.items() if key.startswith(start))


@contextmanager
def readers_forked() -> Iterator[None]:
    """Fork the readers of imports from this process instead of starting them; what they need is imported once."""
    for library in ("scipy.io", "nptdms", "pyarrow.parquet", "pandas", "campaigns.importing.foreign"):
        import_module(library)
    commit = tool_commit()
    with patch.object(isolated, "start_python", forked), patch.object(engine, "tool_commit", lambda: commit):
        yield


def count_forked(cases: int, start: int) -> dict[str, Counter[str]]:
    """Return `count` of all forms with forked readers: a small process of its own is forked fastest."""
    with readers_forked():
        return count(cases, start)


def main() -> int:
    """Count form by form, print each and the smallest case of a broken promise, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000, help="of all forms together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--form", action="append", choices=FORMS, help="one form instead of all; repeatable")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args()
    forms, began = tuple(options.form or FORMS), monotonic()
    found: dict[str, Counter[str]] = {form: Counter() for form in forms}
    with readers_forked():
        for form, tally in found.items():
            try:
                _count(form, -(-options.cases // len(forms)), options.seed, tally)
            except AssertionError as error:
                tally[BROKEN] += 1
                print(error, *getattr(error, "__notes__", ()), sep="\n")
            print(f"{form}: {dict(tally)}", flush=True)
    text = page(found, monotonic() - began)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / f"import-drawn-{datetime.now(UTC):%Y-%m-%d}.md").write_text(text, encoding="utf-8")
    print(text)
    return 1 if any(tally[BROKEN] for tally in found.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
