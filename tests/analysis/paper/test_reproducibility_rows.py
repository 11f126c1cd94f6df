"""Reproducibility of section 6.3.2 as the report reads it, from cycles whose scatter is known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.paper.table_text import _learning, in_step

DWELL, RATE_HZ, HIGH_RAD = 1000, 10_000.0, 8.5e-3


class Learned:
    """Measurements of a campaign that recorded one learning phase and nothing else."""

    def __init__(self, cycles):
        self.phase = SimpleNamespace(
            cycles=lambda axis: {"theta_y": cycles}[axis],
            dwell=DWELL,
            rate_hz=RATE_HZ,
            commanded_rad=np.array([[0.0, 0.0], [0.0, HIGH_RAD]]),
        )

    def settle(self, strategy, alpha_deg, phase="chop"):
        assert (strategy, alpha_deg, phase) == ("repetitive", 90.0, "learning")
        return self.phase


def campaign(cycles) -> Any:
    """What the rows ask of measurements."""
    return Learned(cycles)


def learned(number, slow_rad=1e-6, fast_rad=0.0, halves=0.5):
    """Cycles towards 0 and 8.5 mrad: the error is halved, a dwell is off by `slow_rad`, a sample by `fast_rad`."""
    rng = np.random.default_rng(8)
    offsets = slow_rad * rng.normal(size=(number, 2))
    still = np.repeat(np.array([HIGH_RAD, 0.0]) + offsets, DWELL, axis=1)
    ripple = fast_rad * np.sqrt(2.0) * np.sin(2 * np.pi * 20.0 * np.arange(2 * DWELL) / DWELL + rng.uniform(0, 7))
    left = 5e-3 * halves ** np.arange(number)[:, None]
    return still + left + ripple * rng.choice([-1.0, 1.0], size=(number, 1)), offsets


def test_integration_is_the_scatter_of_means_after_the_papers_twelfth_cycle():
    cycles, offsets = learned(60, fast_rad=2e-5)
    ours = _learning(campaign(cycles))
    kept = offsets[12:]
    expected = 3.0 * np.sqrt(np.var(kept, axis=0, ddof=1).mean())
    # 5 mrad halved twelve times are 1.2 µrad, which fade within three of 48 cycles; a step is a period of the ripple
    assert ours["reproducibility integration"].value == pytest.approx(expected, rel=0.05)
    assert ours["reproducibility integration"].std == pytest.approx(
        ours["reproducibility integration"].value / np.sqrt(2 * 94)
    )
    # a sample has the ripple as well, and a step is judged by its samples
    moving = in_step(DWELL, RATE_HZ)
    of_step = 3.0 * np.sqrt(np.var(cycles[12:][:, moving], axis=0, ddof=1).mean())
    assert ours["reproducibility step"].value == pytest.approx(of_step)
    assert (
        "48 cycles" in ours["reproducibility step"].note and "every sample" in ours["reproducibility integration"].note
    )


def test_what_converges_later_counts_from_there():
    cycles, _ = learned(80, halves=0.8)
    ours = _learning(campaign(cycles))
    at = int(ours["learning iterations"].value)
    assert at > 25 and f"{80 - at} cycles" in ours["reproducibility step"].note


@pytest.mark.parametrize("number", [14, 13])
def test_too_few_converged_cycles_give_no_reproducibility(number):
    assert set(_learning(campaign(learned(number, slow_rad=1e-4)[0]))) == {"learning iterations"}


def test_without_convergence_there_is_none():
    ours = _learning(campaign(learned(30, slow_rad=1e-9, halves=0.9)[0]))
    assert set(ours) == {"learning iterations"} and ours["learning iterations"].value == float("inf")
