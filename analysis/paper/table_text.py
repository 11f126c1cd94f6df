"""The numbers in the text of the chapter that a bench or a design can show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.measurements.learning import learning_curve
from analysis.measurements.reproducibility import reproducibility
from analysis.paper.loop_shape import loop_margins_of
from analysis.paper.measured import RATE_HZ, Measured
from analysis.paper.numbers import paper_tables
from analysis.paper.rows import Ours
from analysis.paper.table_6_6 import powers_of
from analysis.recorded.settle import FORCE_CONSTANT_N_A, STEEPNESS_N_SQRT_W
from analysis.recorded.sweep import difference_of
from sim_backend.control.feedback import LEARNING_GAIN_FACTOR

Array = NDArray[np.float64]

PEAK_CURRENT_A = 9.0
STEP_S = 5e-3

FEWEST_CYCLES = 3
"""Fewer repeats have no scatter to speak of."""


def table_text(measured: Measured) -> dict[str, Ours]:
    """Return our values, test by test."""
    return {
        **_sensors(measured),
        **_hysteresis(measured),
        **_margins(measured),
        **_temperature(measured),
        **_learning(measured),
        **_continuous_force(measured),
        "peak force": Ours(FORCE_CONSTANT_N_A * PEAK_CURRENT_A, note="5.7 N/A times 9 A: the printed numbers disagree"),
    }


def _sensors(measured: Measured) -> dict[str, Ours]:
    ours: dict[str, Ours] = {}
    if (test := measured.theodolite()) is not None:
        for i, axis in enumerate(("theta_x", "theta_y")):
            gain, std = test.calibration.gain_correction[i], test.calibration.gain_correction_std[i]
            ours[f"theodolite {axis}"] = Ours(float(gain), float(std))
    if (stops := measured.endstops()) is not None:
        noise = stops.noise
        worst = np.unravel_index(np.argmax(noise.three_sigma_m), noise.three_sigma_m.shape)
        ours["endstop noise"] = Ours(float(noise.three_sigma_m[worst]), float(noise.three_sigma_std_m[worst]))
    return ours


def _hysteresis(measured: Measured) -> dict[str, Ours]:
    loops = measured.loops("theta_x")
    if not loops:
        return {}
    # a campaign may play any torques: those that the paper prints have a row
    rows = {number.key for number in paper_tables()["text"].rows}
    ours = {f"amplitude {torque:g}": Ours(found.amplitude_rad) for torque, found in loops.items()}
    ours = {key: value for key, value in ours.items() if key in rows}
    ratios = [found.remanence_ratio for found in loops.values()]
    each = ", ".join(f"{100 * ratio:.2f} %" for ratio in ratios)
    return {**ours, "remanence": Ours(float(np.mean(ratios)), note=f"mean over the amplitudes: {each}")}


def _margins(measured: Measured) -> dict[str, Ours]:
    plant = measured.design_axis("theta_x")
    margins, held = loop_margins_of(plant), loop_margins_of(plant, RATE_HZ)
    raised = loop_margins_of(plant, RATE_HZ, LEARNING_GAIN_FACTOR)
    note = (
        "continuous plant, as the printed margin was computed; behind the zero-order hold "
        f"{held.gain_margin_db:.1f} dB, and {raised.gain_margin_db:.1f} dB with the gain × {LEARNING_GAIN_FACTOR:g} of "
        "repetitive control"
    )
    return {
        "gain margin": Ours(margins.gain_margin_db, note=note),
        "phase margin": Ours(float(np.deg2rad(margins.phase_margin_deg))),
        "sensitivity peak": Ours(margins.sensitivity_peak_db),
        "sensitivity frequency": Ours(margins.sensitivity_peak_hz),
    }


def _temperature(measured: Measured) -> dict[str, Ours]:
    ours: dict[str, Ours] = {}
    for axis in ("theta_x", "theta_y"):
        both = measured.temperatures(axis)
        if both is not None:
            found = difference_of(*both)
            at = int(np.argmax(np.abs(found.difference_db)))
            note = f"at {found.largest_hz:g} Hz, {found.chi2_per_point:.1f} times the noise's variance"
            ours[f"temperature {axis}"] = Ours(found.largest_db, float(found.std_db[at]), note)
    return ours


def _continuous_force(measured: Measured) -> dict[str, Ours]:
    """Return the rms force of the busiest actuator in the 5 Hz chop, the worse axis."""
    powers = powers_of(measured, "hybrid")
    if not powers:
        return {}
    busiest_w = max(float(np.max(p.actuator_w)) for p in powers)
    rated_w = (paper_tables()["text"].value("continuous force") / STEEPNESS_N_SQRT_W) ** 2
    note = (
        f"rms over the 5 Hz chop of 8.5 mrad, {busiest_w:.2g} W in that actuator; the rated force alone dissipates "
        f"{rated_w:.2f} W, more than the 1 W that Table 6.6 allows, so the power is the stricter limit"
    )
    return {"continuous force": Ours(STEEPNESS_N_SQRT_W * float(np.sqrt(busiest_w)), note=note)}


def _learning(measured: Measured) -> dict[str, Ours]:
    learning = measured.settle("repetitive", 90.0, "learning")
    if learning is None:
        return {}
    cycles, moving = learning.cycles("theta_y"), in_step(learning.dwell, learning.rate_hz)
    commanded = np.repeat(learning.commanded_rad[::-1, 1], learning.dwell)
    at = learning_curve(np.where(moving, 0.0, cycles - commanded)).converged_at
    iterations = {"learning iterations": Ours(float("inf") if at is None else float(at))}
    if at is None:
        return iterations
    # noise of single samples hides what a mean still shows of the learning: not before the paper's own iteration
    first = max(at, round(paper_tables()["text"].value("learning iterations")))
    return {**iterations, **_reproducibility(cycles[first:], moving, first)}


def _reproducibility(cycles: Array, moving: NDArray[np.bool_], first: int) -> dict[str, Ours]:
    """Return how alike the learned cycles (c, n) are with the feedback open, as section 6.3.2 learns.

    A step counts by its samples, an integration period by its mean, as Fig. 6.16 shows it.
    """
    if len(cycles) < FEWEST_CYCLES:
        return {}
    means = np.stack([half.mean(axis=1) for half in np.split(cycles[:, ~moving], 2, axis=1)], axis=1)
    found = reproducibility(np.hstack([cycles[:, moving], means]), np.arange(moving.sum() + 2) < moving.sum())
    # of a standard deviation of as many independent means: those of both positions, a mean taken from each
    share = (2.0 * means.shape[1] * (len(cycles) - 1)) ** -0.5
    each = 1e6 * reproducibility(cycles, moving).integration
    of = f"{len(cycles)} cycles with open feedback after the {first}th"
    note = f"means of the integration periods of {of}, both positions; of every sample {each:.3g} µrad"
    return {
        "reproducibility step": Ours(found.step, note=f"every sample of the step, {of}"),
        "reproducibility integration": Ours(found.integration, share * found.integration, note),
    }


def in_step(dwell: int, rate_hz: float) -> NDArray[np.bool_]:
    """Return which samples of a period (2 dwell,) belong to the 5 ms of a move."""
    one = np.arange(dwell) < round(STEP_S * rate_hz)
    return np.concatenate([one, one])
