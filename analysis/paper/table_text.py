"""The numbers in the text of the chapter that a bench or a design can show."""

from __future__ import annotations

import numpy as np

from analysis.measurements.learning import learning_curve
from analysis.measurements.reproducibility import reproducibility
from analysis.paper.loop_shape import loop_margins_of
from analysis.paper.measured import Measured
from analysis.paper.numbers import paper_tables
from analysis.paper.rows import Ours
from analysis.recorded.settle import FORCE_CONSTANT_N_A
from analysis.recorded.sweep import difference_of

PEAK_CURRENT_A = 9.0
STEP_S = 5e-3


def table_text(measured: Measured) -> dict[str, Ours]:
    """Return our values, test by test."""
    return {
        **_sensors(measured),
        **_hysteresis(measured),
        **_margins(measured),
        **_temperature(measured),
        **_learning(measured),
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
    margins = loop_margins_of(measured.design_axis("theta_x"))
    return {
        "gain margin": Ours(margins.gain_margin_db, note="continuous plant, as the printed margin was computed"),
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


def _learning(measured: Measured) -> dict[str, Ours]:
    ours: dict[str, Ours] = {}
    learning = measured.settle("repetitive", 90.0, "learning")
    if learning is not None:
        cycles = learning.cycles("theta_y")
        commanded = np.repeat(learning.commanded_rad[::-1, 1], learning.dwell)
        error = np.where(in_step(learning.dwell, learning.rate_hz), 0.0, cycles - commanded)
        at = learning_curve(error).converged_at
        ours["learning iterations"] = Ours(float("inf") if at is None else float(at))
    chop = measured.settle("hybrid", 90.0)
    if chop is not None:
        found = reproducibility(chop.cycles("theta_y")[1:], in_step(chop.dwell, chop.rate_hz))
        ours["reproducibility step"] = Ours(found.step)
        ours["reproducibility integration"] = Ours(found.integration)
    return ours


def in_step(dwell: int, rate_hz: float) -> np.ndarray:
    """Return which samples of a period (2 dwell,) belong to the 5 ms of a move."""
    one = np.arange(dwell) < round(STEP_S * rate_hz)
    return np.concatenate([one, one])
