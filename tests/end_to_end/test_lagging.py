"""A slow amplifier, recorded by another process: what is nonlinear beside it is named, its own wrong form is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.end_to_end.lagging_bench import LAG_S
from tests.end_to_end.test_unlisted_force import NOMINAL, recorded
from tests.end_to_end.unknown_bench import diagnosis


def _causes(folder: Path, second: float, cubic: float) -> dict[str, dict[str, float]]:
    recorded(folder, "lagging_bench", second, cubic)
    (folder / "nominal.toml").write_text(NOMINAL, encoding="utf-8")
    found = diagnosis(folder)
    assert found["verdict"] == "named", found["sentence"]
    return {c["effect"]: {name: one["value"] for name, one in c["parameters"].items()} for c in found["causes"]}


@pytest.mark.parametrize("second", [0.0, 0.2])
def test_a_lag_of_another_form_has_no_second_cause(tmp_path: Path, second: float) -> None:
    """What is left of two lags beside one of their sum is many times the noise, and linear."""
    causes = _causes(tmp_path, second, 0.0)
    assert set(causes) == {"amplifier-lag"}
    assert abs(causes["amplifier-lag"]["time_constant_s"] / ((1.0 + second) * LAG_S) - 1.0) < 0.02


@pytest.mark.parametrize("second", [0.0, 0.2])
def test_a_spring_far_smaller_than_a_lag_is_named_beside_it(tmp_path: Path, second: float) -> None:
    """It explains a thousandth of what the lag does: less than another form of that may be worth."""
    causes = _causes(tmp_path, second, 3e-4)
    assert set(causes) == {"amplifier-lag", "cubic-stiffness"}
    assert abs(causes["cubic-stiffness"]["stiffness"] / 3e-4 - 1.0) < 0.1


def test_a_spring_that_explains_less_than_a_percent_of_an_amplitude_is_named_beside_a_lag(tmp_path: Path) -> None:
    """Less than 10⁻⁴ of what the lag explains: more than its distortion may be, and none of it follows the drive."""
    causes = _causes(tmp_path, 0.0, 1e-4)
    assert set(causes) == {"amplifier-lag", "cubic-stiffness"}
    assert abs(causes["cubic-stiffness"]["stiffness"] / 1e-4 - 1.0) < 0.1


def test_of_a_lag_and_a_spring_of_one_size_neither_is_something_else(tmp_path: Path) -> None:
    """A loop that stiffens explains more by itself than either, and is found first."""
    causes = _causes(tmp_path, 0.0, 1e-2)
    assert set(causes) == {"amplifier-lag", "cubic-stiffness"}
    assert abs(causes["cubic-stiffness"]["stiffness"] / 1e-2 - 1.0) < 0.01
