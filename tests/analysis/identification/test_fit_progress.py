"""A fit with several numbers of modes tells how far it is."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from analysis.identification.rational import fit_rational
from analysis.identification.timefit import fit_records
from tests.listening import Listener


def assert_rises(heard: Listener, numbers: set[str]) -> None:
    assert heard.shares[0] == 0.0 and heard.shares == sorted(heard.shares) and heard.shares[-1] < 1.0
    assert {text.split()[1] for text in heard.said} == numbers


def test_in_frequency() -> None:
    f = np.linspace(1.0, 100.0, 60)
    s = 2j * np.pi * f
    modes = [(2 * np.pi * at) ** 2 / (s**2 + 10.0 * s + (2 * np.pi * at) ** 2) for at in (20.0, 60.0)]
    response = np.sum(modes, axis=0)
    heard = Listener()
    fit_rational(f, response[:, None, None], (1, 2), report=heard)
    assert_rises(heard, {"1", "2"})
    assert heard.shares == [0.0, 1.0 / 3.0]  # a fit takes as long as it has modes


def test_in_time() -> None:
    rng = np.random.default_rng(0)
    u = rng.normal(size=600)
    y = lfilter([0.0, 0.1, 0.1], [1.0, -1.8, 0.9], u) + 0.01 * rng.normal(size=600)
    heard = Listener()
    fit_records([u[:, None]], [y[:, None]], 100.0, (1, 2), report=heard)
    assert_rises(heard, {"1", "2"})
