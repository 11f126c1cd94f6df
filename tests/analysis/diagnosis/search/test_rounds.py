"""Which trials of a round are compared with care."""

from __future__ import annotations

from analysis.diagnosis.search.rounds import n_compared


def test_what_would_be_tied_is_compared_under_its_own_noise() -> None:
    # a lead is twice a logarithm: 99 to 1 is 9.2, and twice that far behind is close
    leads = [100.0, 99.0, 95.0, 90.0, 85.0, 81.0, 0.0]
    assert n_compared(leads, known=False) == 5
    assert n_compared(leads, known=True) == 3


def test_three_are_compared_however_far_they_trail() -> None:
    assert n_compared([1000.0, 10.0, 5.0, 1.0], known=False) == 3
