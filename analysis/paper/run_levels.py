"""Table 6.7 with a level of the disturbance for every run: position 1 sets it, and position 2 is then predicted."""

from __future__ import annotations

import math

import numpy as np

from analysis.paper.numbers import paper_tables
from analysis.paper.pieces import Evidence
from analysis.paper.table_6_7 import ALPHAS_DEG, FORMS

RADIUS_RAD = 1.7e-6


def level_rad(share: float) -> float:
    """Return 3σ (rad) of each angle at which a share of the positions lies within 1.7 µrad of their mean.

    Both angles are taken as Gaussian, independent and equally noisy: the distance is Rayleigh distributed.
    """
    return 3.0 * RADIUS_RAD / math.sqrt(-2.0 * math.log(1.0 - share))


def share_inside(three_sigma_rad: float) -> float:
    """Return the share of positions within 1.7 µrad of their mean; the inverse of `level_rad`."""
    return 1.0 - math.exp(-0.5 * (3.0 * RADIUS_RAD / three_sigma_rad) ** 2)


def printed_shares() -> dict[str, tuple[float, float]]:
    """Return the shares at positions 1 and 2 of every run, by α and end points."""
    table = paper_tables()["6.7"]
    return {
        f"{alpha} {form}": (table.value(f"{alpha} {form} 1"), table.value(f"{alpha} {form} 2"))
        for alpha in ALPHAS_DEG
        for form in FORMS
    }


def misses(shares: dict[str, tuple[float, float]]) -> tuple[float, float]:
    """Return the rms by which position 2 is missed, in shares: with a level per run, and with one level for all runs.

    The one level is the rms of those of position 1.
    """
    second = np.array([two for _, two in shares.values()])
    own = np.array([one for one, _ in shares.values()])
    common = share_inside(float(np.sqrt(np.mean([level_rad(one) ** 2 for one in own]))))
    return float(np.sqrt(np.mean((own - second) ** 2))), float(np.sqrt(np.mean((common - second) ** 2)))


def run_levels() -> Evidence:
    """What a level per run, calibrated on position 1, predicts for position 2, against one level for all runs."""
    shares = printed_shares()
    rows = []
    for run, (first, second) in shares.items():
        alpha, form = run.split(" ")
        rows.append(
            (
                f"α {alpha}°, {form.replace(':', ' to ')} mrad",
                f"{100 * first:.2f}",
                f"{1e6 * level_rad(first):.2f}",
                f"{100 * share_inside(level_rad(first)):.2f}",
                f"{100 * second:.2f}",
            )
        )
    own, common = misses(shares)
    centre = [1e6 * level_rad(shares[f"{alpha} {form}"][0]) for alpha in ALPHAS_DEG for form in ("0:+8.5", "0:-8.5")]
    return Evidence(
        "The disturbance changed from run to run",
        "Position 1 of the runs from 0 is the same point, at rest under the same feedback. Its percentage differs all "
        "the same. A level of the disturbance for each run, calibrated on position 1, predicts position 2:",
        ("run", "position 1 (%)", "3σ that it means (µrad)", "position 2, predicted (%)", "position 2, printed (%)"),
        tuple(rows),
        f"At that one point the runs mean {min(centre):.2f} to {max(centre):.2f} µrad. Position 2 is missed by "
        f"{100 * own:.2f} % (rms) with a level per run, and by {100 * common:.2f} % with one level for all. The "
        "campaign plays the levels, a little lower than these stand for 3σ, because the sensors' noise keeps its own.",
    )
