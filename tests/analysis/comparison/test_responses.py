"""Two measured responses against what was put into them: other grids, lucky variances, no noise, other phases."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.comparison.responses import compared, entry_of
from analysis.comparison.table import Row
from analysis.identification.response_curves import ResponseCurve
from sim_backend.linear import Array

UNITS = {("y", "u"): "rad per N m"}


def resonance(f: Array) -> np.ndarray:
    """A mode at 30 Hz with a damping ratio of 2 %."""
    return 1.0 / (1.0 - (f / 30.0) ** 2 + 0.04j * f / 30.0)


def curve(f: Array, response: np.ndarray, std: Array) -> ResponseCurve:
    return ResponseCurve("y", "u", f, np.abs(response), np.angle(response), std, std)


def measured(
    f: Array, rng: np.random.Generator, relative: float = 0.01, truth: np.ndarray | None = None
) -> ResponseCurve:
    """The response with noise of a part of each line, its variance from one degree of freedom."""
    true = resonance(f) if truth is None else truth
    std = relative * np.abs(true)
    noise = std * (rng.normal(size=f.size) + 1j * rng.normal(size=f.size))
    return curve(f, true + noise, std * np.sqrt(rng.exponential(size=f.size)))


def said_of(one: ResponseCurve, other: ResponseCurve) -> tuple[list[Row], str]:
    return compared(([entry_of(one)], [entry_of(other)]), UNITS)


@pytest.mark.parametrize("apart_hz", [1.0, 1.3])
def test_one_response_on_two_grids_agrees_and_shows_its_peak(apart_hz: float) -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        first = measured(np.arange(5.0, 200.0, 1.0), rng)
        rows, said = said_of(first, measured(np.arange(5.0, 200.0, apart_hz), rng))
        assert "A and B agree within noise" in said, (seed, said)
        mean, peak = rows
        assert mean.sigmas is not None and mean.sigmas < 4.0
        assert peak.first == pytest.approx(30.0, abs=1.5) and peak.second == pytest.approx(30.0, abs=1.5)
        assert peak.std[0] is not None and 0.0 < peak.std[0] < 2.0


def test_a_response_a_hundredth_larger_differs_in_the_mean() -> None:
    f, rng = np.arange(5.0, 400.0), np.random.default_rng(1)
    rows, said = said_of(measured(f, rng), measured(f, rng, truth=1.01 * resonance(f)))
    # 395 lines of 1 % give their ratio to 1 % x sqrt(2 x 2 / 395) = 0.1 %
    assert "differ by more than noise in their mean" in said
    first, second = rows[0].first, rows[0].second
    assert isinstance(first, float) and isinstance(second, float)
    assert second / first - 1.0 == pytest.approx(0.01, rel=0.4)


def test_a_delay_differs_though_the_magnitudes_agree() -> None:
    f, rng = np.arange(5.0, 400.0), np.random.default_rng(2)
    _, said = said_of(measured(f, rng), measured(f, rng, truth=resonance(f) * np.exp(-2j * np.pi * f * 1e-3)))
    assert "A and B differ by more than noise at" in said


def test_noise_alone_is_no_response() -> None:
    f = np.arange(1.0, 2000.0)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        nothing = [measured(f, rng, 1.0, 1e-3 * np.ones(f.size, dtype=complex)) for _ in range(2)]
        rows, said = said_of(*nothing)
        assert rows == [] and said.startswith("Left out of table and figures") and "u → y" in said
        assert not entry_of(nothing[0]).known.any()


def test_what_one_record_alone_knows_is_not_compared() -> None:
    f, rng = np.arange(5.0, 200.0), np.random.default_rng(3)
    rows, said = said_of(measured(f, rng), measured(f, rng, relative=2.0))
    assert rows == [] and said == "u → y: no frequency is known to 10 % in both."


def test_without_an_uncertainty_no_agreement_is_stated() -> None:
    f = np.arange(5.0, 200.0)
    unknown = curve(f, resonance(f), np.full(f.size, np.nan))
    rows, said = said_of(unknown, unknown)
    assert rows[0].std == (None, None) and rows[0].sigmas is None and rows[0].difference == 0.0
    assert "what differs may be noise" in said and "agree" not in said
