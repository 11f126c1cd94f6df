"""The measurement of studies measures what ran, and notices when two engines disagree."""

from __future__ import annotations

from pathlib import Path

from benchmarks.study_cost import book_keeping, same, studied


def test_one_small_study_and_its_book_keeping_are_measured(tmp_path: Path) -> None:
    rows = [studied("spread", 1, tmp_path, "--workers", str(n)) for n in (1, 2)]
    for row in rows:
        assert row["trials"] == 2  # one draw at two points
        assert 0.0 < row["mean_trial_s"] < row["wall_s"] and row["peak_mb"] > 50.0
    assert same(rows)
    assert not same([rows[0], {**rows[1], "sha256": "other"}])
    kept = book_keeping(200, 100, tmp_path)
    size = kept["bytes_per_trial"]
    assert size["trials.sqlite"] > 100.0  # ten numbers of 8 bytes, and what SQLite needs around them
    assert size["trials.csv"] > 100.0
