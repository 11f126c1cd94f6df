"""A known record in drawn forms, dialects, units and clocks comes back in SI, or is refused for its flaw."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from benchmarks.drawn_records import FLAWS, FORMS, REFUSED
from benchmarks.soak_imports import NO_FLAW, count, count_forked, main
from campaigns.importing.record import to_si
from sim_backend.errors import DataError

pytest.importorskip("nptdms")
pytest.importorskip("pyarrow")


def check(cases: int, start: int) -> None:
    """Draw so many records of each form: `count` ends with the first that breaks a promise.

    In a process of its own: a reader is forked for each record, which takes as long as the process is large.
    """
    with ProcessPoolExecutor(1, get_context("spawn")) as alone:
        found = alone.submit(count_forked, cases, start).result()
    assert set(found) == set(FORMS)
    for form, tally in found.items():
        assert tally.total() >= cases, form
        assert tally[f"read: {NO_FLAW}"] > 0 and tally[f"refused: {NO_FLAW}"] == 0, form
        assert all(tally[f"read: {flaw}"] == 0 for flaw in REFUSED), form


def test_records_of_every_form_come_back_in_si_or_are_refused() -> None:
    check(4, 1)


def test_two_thousand_records() -> None:
    check(2_000 // len(FORMS) + 1, 2)


def test_a_difference_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("campaigns.importing.gathering.to_si", lambda *given: to_si(*given) * (1.0 + 1e-12))
    with pytest.raises(AssertionError, match="Not equal"):
        count(5, forms=("npy",))


def test_a_refusal_without_a_flaw_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise DataError("no")

    monkeypatch.setattr("campaigns.importing.gathering.to_si", refuse)
    with pytest.raises(AssertionError, match="npy, matrix is refused"):
        count(5, forms=("npy",))


def test_the_page_counts_every_form_and_flaw(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("sys.argv", ["soak_imports", "--cases", "10", "--form", "csv", "--out", str(tmp_path)])
    assert main() == 0
    (page,) = tmp_path.glob("import-drawn-*.md")
    text = page.read_text(encoding="utf-8")
    assert (
        "| csv | 10 |" in text
        and "**1**" not in text
        and "| **all** | 10 |" in text
        and all(f"| {flaw} |" in text for flaw in FLAWS)
    )
    assert text in capsys.readouterr().out
