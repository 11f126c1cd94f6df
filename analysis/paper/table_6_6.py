"""Table 6.6: the requirements and what the campaign achieved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.measurements.power import CoilPower
from analysis.paper.measured import Measured
from analysis.paper.numbers import UNIT_SI, paper_tables
from analysis.paper.rows import Ours
from analysis.paper.settling_seeds import settling_seeds
from analysis.paper.table_6_7 import FORMS
from analysis.recorded.chop import ChopPhase
from analysis.recorded.settle import FORCE_CONSTANT_N_A, STEEPNESS_N_SQRT_W
from sim_backend.errors import DataError

ALPHA_OF = {"theta_x": 0.0, "theta_y": 90.0}


@dataclass(frozen=True)
class Played:
    """Which strategy each requirement is judged by: slow chops, fast settling, power, the long chop."""

    slow: str = "hybrid"
    fast: str = "repetitive"
    power: str = "hybrid"
    long: str = "hybrid"


PAPER = Played()
PROJECT = Played("designed", "designed", "designed", "designed")


def table_6_6(measured: Measured, played: Played = PAPER) -> dict[str, Ours]:
    """Return our value of every requirement that a bench can show, with the strategies of the paper or others."""
    return {
        **_stability(measured, played.slow),
        **_repeatability(measured, played.long),
        **_settling(measured, played.fast),
        **_drive(measured, played.power),
        **_thermal(measured, played.long),
    }


def standard_chops(measured: Measured, strategy: str = PAPER.slow) -> list[ChopPhase]:
    """Return the slow chops of the standard end points, 0 to ±8.5 mrad at every α."""
    found = [measured.chop(alpha, *FORMS[form], strategy) for alpha, form in STANDARD]
    return [chop for chop in found if chop is not None]


STANDARD = [(alpha, form) for alpha in (0.0, 120.0, 240.0) for form in ("0:+8.5", "0:-8.5")]


def _stability(measured: Measured, strategy: str) -> dict[str, Ours]:
    """Return the largest of all standard end points, positions and, of 3σ, axes: the paper prints upper bounds."""
    chops = standard_chops(measured, strategy)
    if not chops:
        return {}
    results = [chop.stability() for chop in chops]
    three_sigma = np.stack([r.three_sigma_rad for r in results])
    errors = np.stack([r.three_sigma_std_rad for r in results])
    worst = np.unravel_index(np.argmax(three_sigma), three_sigma.shape)
    pooled = f"{1e6 * np.sqrt(np.mean(three_sigma**2)):.3g} µrad over all of them"
    note = f"largest of {three_sigma.size} values of end points, positions and axes; {pooled}"
    return {
        "stability": Ours(float(three_sigma[worst]), float(errors[worst]), note),
        "accuracy": Ours(max(float(r.accuracy_rad.max()) for r in results)),
        "parasitic z": Ours(max(float(np.max(np.abs(chop.read("z")))) for chop in chops)),
    }


def _repeatability(measured: Measured, strategy: str) -> dict[str, Ours]:
    """Return how far the mean of any integration period lies from the mean of all, at most; Fig. 6.16."""
    test = measured.drift(strategy)
    if test is None:
        return {}
    offset = test.offset_rad
    note = f"largest offset of {offset[..., 0].size} integration periods of the 5 Hz chop, as Fig. 6.16 shows them"
    return {"repeatability": Ours(float(np.max(np.hypot(offset[..., 0], offset[..., 1]))), note=note)}


def _settling(measured: Measured, strategy: str) -> dict[str, Ours]:
    ours: dict[str, Ours] = {}
    for axis in ALPHA_OF:
        worst = settled_s(measured, strategy, axis)
        if worst is None:
            continue
        note = "the mean move, worse of both positions" if np.isfinite(worst) else "not settled before the next move"
        share = _share_of_seeds(measured) if (strategy, axis) == (PAPER.fast, "theta_x") else None
        if share is not None:
            note += f"; {settling_seeds().said(share)}"
        ours[f"settling {axis}"] = Ours(worst, note=note, share=share)
    return ours


def _share_of_seeds(measured: Measured) -> float | None:
    """Return the share of seeds whose θx settles as the paper prints it; None for a run that the study did not play."""
    phase, seeds = measured.settle(PAPER.fast, ALPHA_OF["theta_x"]), settling_seeds()
    if phase is None or not seeds.covers(phase.run.header.bench, phase.run.header.settings):
        return None
    printed = paper_tables()["6.6"].number("settling theta_x")
    si = UNIT_SI[printed.unit]
    return seeds.share_within(paper_tables()["6.6"].value(printed.key), printed.tolerance * si)


def settled_s(measured: Measured, strategy: str, axis: str) -> float | None:
    """Return when the mean move of an axis has settled, the worse of both positions; None where it was not played."""
    phase = measured.settle(strategy, ALPHA_OF[axis])
    return None if phase is None else float(np.max(phase.settling(axis).time_s))


def powers_of(measured: Measured, strategy: str) -> list[CoilPower]:
    """Return what the 5 Hz chop of each axis takes, none where it was not played or no current was measured."""
    phases = [measured.settle(strategy, alpha) for alpha in ALPHA_OF.values()]
    try:
        return [p.power(FORCE_CONSTANT_N_A, STEEPNESS_N_SQRT_W) for p in phases if p is not None]
    except DataError:  # a bench that measures no currents
        return []


def _drive(measured: Measured, strategy: str) -> dict[str, Ours]:
    """A 5 Hz chop of 8.5 mrad, the worse axis."""
    powers = powers_of(measured, strategy)
    if not powers:
        return {}
    return {
        "power": Ours(max(p.total_w for p in powers), note="worse axis"),
        "peak current": Ours(max(p.peak_a for p in powers), note="worse axis"),
    }


def _thermal(measured: Measured, strategy: str) -> dict[str, Ours]:
    test = measured.drift(strategy)
    if test is None:
        return {}
    totals = np.array([d.total_rad for d in test.drift])
    stds = np.array([d.std_rad for d in test.drift])
    worst = np.unravel_index(np.argmax(np.abs(totals)), totals.shape)
    return {"thermal": Ours(float(abs(totals[worst])), float(stds[worst]), "worst position and axis")}
