"""Linear benches that nobody has described: what is imported and identified by the command line is *consistent*."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.end_to_end.linear_bench import RECORDS
from tests.end_to_end.unknown_bench import diagnosis, identified, imported, write_record

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", RECORDS)
def test_a_linear_record_is_consistent(name: str, tmp_path: Path) -> None:
    write_record(tmp_path, RECORDS[name]())
    imported(tmp_path)
    identified(tmp_path)
    found = diagnosis(tmp_path)
    causes = [cause["effect"] for cause in found["causes"]]
    assert (found["verdict"], causes) == ("consistent", []), (found["sentence"], found["notes"])
    assert found["exit_code"] == 0
