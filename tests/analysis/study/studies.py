"""Small studies for the tests: fast chops of the bench as built."""

from __future__ import annotations

from pathlib import Path

from analysis.study.definition import Study, parse_study

SPREAD = """
schema = "mccd-study/1"
name = "spread"
kind = "settling"
trials = {trials}
seed = 3
[settings]
cycles = 2
[[vary]]
place = "model.modes[theta_y suspension].frequency_hz"
relative = true
normal = {{ std = 0.01 }}
[[vary]]
place = "settings.strategy"
sweep = ["hybrid", "mbff"]
"""

RESULTS = ("trials.csv", "study.json", "study.svg")


def spread(trials: int = 5, more: str = "") -> Study:
    """Return a study of a fast chop over one frequency and two strategies."""
    return parse_study(SPREAD.format(trials=trials) + more, "study")


def results(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every file that must not depend on how the trials were done."""
    return {name: (folder / name).read_bytes() for name in RESULTS}
