"""Linear benches that nobody has described: what is imported and identified by the command line is *consistent*."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.end_to_end.linear_bench import RECORDS, Record
from tests.end_to_end.unknown_bench import diagnosis, identified, imported

pytestmark = pytest.mark.slow

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


def write(folder: Path, record: Record) -> None:
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


@pytest.mark.parametrize("name", RECORDS)
def test_a_linear_record_is_consistent(name: str, tmp_path: Path) -> None:
    write(tmp_path, RECORDS[name]())
    imported(tmp_path)
    identified(tmp_path)
    found = diagnosis(tmp_path)
    causes = [cause["effect"] for cause in found["causes"]]
    assert (found["verdict"], causes) == ("consistent", []), (found["sentence"], found["notes"])
    assert found["exit_code"] == 0
