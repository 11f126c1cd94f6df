"""Readings of an instrument that are none end in one clear error."""

from pathlib import Path

import pytest

from analysis.recorded.readings import read_angles
from sim_backend.errors import DataError


@pytest.mark.parametrize(
    "text", ["", "a\n", "{\n1,2,3\n", "theta_x,theta_y\n1,2,3\n1,x\n", "theta_x,theta_y\n1\n1,nan\n"]
)
def test_what_is_no_reading_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "readings.csv"
    path.write_text(text)
    with pytest.raises(DataError, match="readings.csv: "):
        read_angles(path, 2)
