"""From two columns of numbers to a diagnosis, by the commands that the owner of an unknown bench would type."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests import running
from tests.end_to_end.linear_bench import Record

Array = NDArray[np.float64]

MAP = """
[log]
test = "{test}"
source = "data.csv"
sample_rate_hz = {rate}
{period}
[channels.drive]
select = "u"
unit = "{unit}"
role = "input"
dof = "x"
[channels.position]
select = "y"
unit = "m"
role = "output"
dof = "x"
[segments]
{segments}
"""


LOG = """[log]
test = "{test}"
source = "data.csv"
sample_rate_hz = {rate}
{period}
"""
CHANNEL = """[channels.{name}]
select = "{name}"
unit = "{unit}"
role = "{role}"
dof = "{dof}"
"""


HANGS_S = 900
"""A command that takes longer hangs: on slow cores that others use as well, the longest diagnoses take five minutes."""


def mccd(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Return what the command did in `folder`."""
    return running.mccd(*arguments, cwd=folder, timeout=HANGS_S)


def write_map(
    folder: Path, rate_hz: float, parts: Sequence[tuple[str, int]], period: int | None = None, unit: str = "V"
) -> None:
    """Write the map of data.csv: labels with their numbers of rows, one after the other; `unit` is the drive's."""
    ends = np.cumsum([rows for _, rows in parts])
    lines = [f'"{label}" = [{end - rows}, {end}]' for (label, rows), end in zip(parts, ends, strict=True)]
    test, repeats = ("free-run", "") if period is None else ("multisine", f"period = {period}")
    text = MAP.format(test=test, rate=rate_hz, period=repeats, unit=unit, segments="\n".join(lines))
    (folder / "map.toml").write_text(text)


def write_data(folder: Path, u: Array, y: Array) -> None:
    """Write drive and reading, (n,) each, as two named columns of text."""
    np.savetxt(folder / "data.csv", np.stack([u, y], axis=1), delimiter=",", header="u,y", comments="")


def write_record(folder: Path, record: Record) -> None:
    """Write a record as columns of text, and the map that says what they are."""
    columns = {f"u{i + 1}": (drive, "V", "input", f"x{i + 1}") for i, drive in enumerate(record.drives.T)}
    columns |= {f"y{i + 1}": (reading, "m", "output", f"x{i + 1}") for i, reading in enumerate(record.readings.T)}
    if record.reference is not None:
        columns["r"] = (record.reference, "m", "reference", "x1")
    values = np.column_stack([values for values, *_ in columns.values()])
    np.savetxt(folder / "data.csv", values, delimiter=",", header=",".join(columns), comments="")
    test, period = ("free-run", "") if record.period is None else ("multisine", f"period = {record.period}")
    text = LOG.format(test=test, rate=record.rate_hz, period=period)
    for name, (_, unit, role, dof) in columns.items():
        text += CHANNEL.format(name=name, unit=unit, role=role, dof=dof)
    ends = np.cumsum([rows for _, rows in record.parts])
    text += "[segments]\n"
    text += "\n".join(f'"{label}" = [{end - n}, {end}]' for (label, n), end in zip(record.parts, ends, strict=True))
    (folder / "map.toml").write_text(text + "\n")


def imported(folder: Path) -> None:
    """Turn what map.toml describes into run.h5."""
    done = mccd(folder, "import", "map.toml", "-o", "run.h5")
    assert done.returncode == 0, done.stderr


def identified(folder: Path, *options: str) -> None:
    """Fit nominal.toml to run.h5."""
    done = mccd(folder, "identify", "--log", "run.h5", *options, "-o", "nominal.toml")
    assert done.returncode == 0, done.stderr


def diagnosis(folder: Path, page: str = "--no-page") -> dict[str, Any]:
    """Return diagnosis.json of run.h5 and nominal.toml, and the command's `exit_code`; with `--page` it draws one."""
    done = mccd(folder, "diagnose", "run.h5", "--model", "nominal.toml", "-o", "out", "--json", page)
    assert done.returncode in (0, 1), done.stderr
    return dict(json.loads(done.stdout), exit_code=done.returncode)


def diagnosed(folder: Path, u: Array, y: Array, rate_hz: float) -> dict[str, Any]:
    """Return the diagnosis of drive `u` and reading `y` (n,), its last quarter held out; nobody knows a model."""
    write_data(folder, u, y)
    split = 3 * u.size // 4
    write_map(folder, rate_hz, [("train", split), ("held-out end", u.size - split)])
    imported(folder)
    identified(folder)
    return diagnosis(folder)
