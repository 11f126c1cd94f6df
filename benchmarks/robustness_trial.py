"""One bench, one strategy: what its chops measure, whether the bench stayed safe, and what of Table 6.6 is missed."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.measurements.chop import chop_stability, observation_windows
from analysis.measurements.power import coil_power
from analysis.measurements.settling import settling
from analysis.recorded.requirements import (
    ACCURACY_RAD,
    PARASITIC_Z_M,
    PEAK_CURRENT_A,
    POWER_W,
    REPEATABILITY_RAD,
    SETTLING_S,
    STABILITY_RAD,
)
from analysis.recorded.settle import FORCE_CONSTANT_N_A, STEEPNESS_N_SQRT_W
from benchmarks.robustness_benches import AXES
from campaigns.plans import make_plan
from campaigns.plans.base import checked_segments
from sim_backend.bench import Limits, Record
from sim_backend.errors import CheckError, ConfigError, MccdError
from sim_backend.model import Model
from sim_backend.simbench import SimBench

Array = NDArray[np.float64]
Judge = Callable[[Model, int], dict[str, float]]

CYCLES = 12
SLOW_CYCLES = 5
SLOW_ALPHA_DEG = 120.0
"""A direction in which both axes move."""

STRAY_RAD, STEP_S, UNSAFE_CYCLES = 50e-6, 5e-3, 3

LIMITS = {
    "settling theta_x": SETTLING_S,
    "settling theta_y": SETTLING_S,
    "stability": STABILITY_RAD,
    "repeatability": REPEATABILITY_RAD,
    "accuracy": ACCURACY_RAD,
    "power theta_x": POWER_W,
    "power theta_y": POWER_W,
    "current theta_x": PEAK_CURRENT_A,
    "current theta_y": PEAK_CURRENT_A,
    "z theta_x": PARASITIC_Z_M,
    "z theta_y": PARASITIC_Z_M,
}


class StoppedError(CheckError):
    """A chop was stopped by its watch, or refused before it began; `safe` tells whether that was in time."""

    def __init__(self, why: str, safe: bool) -> None:
        super().__init__(why)
        self.safe = safe


def is_safe(records: list[Record], limits: Limits, rate_hz: float) -> bool:
    """Tell whether no axis strays after its step, and the power keeps its limit, but for UNSAFE_CYCLES in a row."""
    bad, longest, coil = 0, 0, limits.coil
    assert coil is not None
    skip = round(STEP_S * rate_hz)
    for record in records:
        segment, settings = record.segment, record.segment.settings
        period, dwell = segment.reference.shape[0], int(settings["dwell_samples"])
        for first in range(0, segment.n_samples - period + 1, period):
            rows = slice(first, first + period)
            command = np.stack([record.channels[f"command_{dof}"][rows] for dof in (*AXES, "z")], axis=1)
            power = np.sum(
                (coil.force_constant_n_a / coil.steepness_n_sqrt_w * command @ limits.to_current.T) ** 2, axis=1
            )
            reading = np.stack([record.channels[dof][rows] for dof in AXES], axis=1)
            error = np.roll(segment.reference[:, : len(AXES)] - reading, -int(settings["position_2_at"]), axis=0)
            worst = np.max(np.abs(error.reshape(2, dwell, len(AXES))[:, skip:]))  # what is not a number stays none
            bad = bad + 1 if not (power.mean() <= POWER_W and worst <= STRAY_RAD) else 0
            longest = max(longest, bad)
    return longest <= UNSAFE_CYCLES


def played(
    bench: Model, seed: int, plan: str, **settings: object
) -> tuple[dict[str, Array], dict[str, float | str], bool]:
    """Return the channels of the chop itself, from a move to position 2 on, its settings, and whether all was safe.

    Raises StoppedError where the plan is refused before anything moves, or the watch stops it, as a run does.
    """
    sim, parts, every = SimBench(bench, seed), list[Record](), list[Record]()
    try:
        made = make_plan(plan, settings)
        watch, segments = made.watch(sim), list(checked_segments(made, sim))
    except ConfigError as error:
        raise StoppedError(f"refused: {error}", safe=True) from None
    for segment in segments:
        record = sim.play(segment if watch is None else watch.asked(segment))
        every.append(record)
        if watch is not None and (why := watch.failure(segment, record)):
            if (found := watch.fallback(segment)) is not None:
                every.append(sim.play(watch.asked(found[0])))
            raise StoppedError(why, is_safe(every, sim.limits, sim.rate_hz))
        if segment.settings["phase"] == "chop":
            parts.append(record)
    first = int(parts[0].segment.settings["position_2_at"])
    channels = {name: np.concatenate([p.channels[name] for p in parts])[first:] for name in parts[0].channels}
    return channels, dict(parts[0].segment.settings), is_safe(every, sim.limits, sim.rate_hz)


def fast(bench: Model, seed: int, axis: str, **settings: object) -> dict[str, float]:
    """Return settling, power, current and parasitic motion of a 5 Hz chop of one axis."""
    channels, own, safe = played(bench, seed, "settling", alpha_deg=AXES[axis], cycles=CYCLES, **settings)
    dwell = int(own["dwell_samples"])
    angle = channels[axis][: channels[axis].size // (2 * dwell) * 2 * dwell].reshape(-1, 2, dwell)
    mean = angle[1:].mean(axis=0)
    settled = settling(mean, bench.sample_rate_hz, np.array([own["to_rad"], own["from_rad"]]))
    names = [n for n in channels if n.startswith("current_")]
    power = coil_power(
        np.stack([channels[n] for n in names], axis=1), FORCE_CONSTANT_N_A, STEEPNESS_N_SQRT_W, 2 * dwell
    )
    return {
        f"settling {axis}": float(np.max(settled.time_s)),
        f"power {axis}": power.total_w,
        f"current {axis}": power.peak_a,
        f"z {axis}": float(np.max(np.abs(channels["z"]))),
        f"safe {axis}": float(safe),
    }


def slow(bench: Model, seed: int, **settings: object) -> dict[str, float]:
    """Return stability, repeatability and accuracy of a slow chop in which both axes move."""
    channels, own, safe = played(bench, seed, "chop", alpha_deg=SLOW_ALPHA_DEG, cycles=SLOW_CYCLES, **settings)
    both = np.stack([channels["theta_x"], channels["theta_y"]], axis=1)
    windows = observation_windows(both, 2, int(own["dwell_samples"]), int(own["window_samples"]))[::-1]
    alpha = np.deg2rad(SLOW_ALPHA_DEG)
    levels = np.array([own["from_rad"], own["to_rad"]])
    found = chop_stability(windows, levels[:, None] * np.array([np.cos(alpha), np.sin(alpha)]))
    return {
        "stability": found.stability_rad,
        "repeatability": float(np.max(found.repeatability_rad)),
        "accuracy": float(np.max(found.accuracy_rad)),
        "inside": float(np.min(found.inside_percent)),
        "safe chop": float(safe),
    }


def judge_of(quick: str, calm: str, **settings: object) -> Judge:
    """Return what plays the slow chop with the strategy `calm`, and the fast ones with `quick`."""

    def judged(bench: Model, seed: int) -> dict[str, float]:
        out = slow(bench, seed, strategy=calm, **settings)
        for axis in AXES:
            out |= fast(bench, seed + 1, axis, strategy=quick, **settings)
        return out

    return judged


def verdict(judge: Judge, bench: Model, seed: int) -> dict[str, Any]:
    """Return what a judge measures, None for a number that is none; for a chop that failed, why and whether safely."""
    try:
        found = judge(bench, seed)
    except MccdError as error:
        return {"error": str(error), "safe": isinstance(error, StoppedError) and error.safe}
    return {k: v if np.isfinite(v) else None for k, v in found.items()}


def misses(found: Mapping[str, Any]) -> list[str]:
    """Return the requirements that a result misses; a number that is none misses its own."""
    return [k for k, limit in LIMITS.items() if (v := found.get(k)) is None or not v <= limit]


def is_kept_safe(found: Mapping[str, Any]) -> bool:
    """Tell whether all chops of a result were safe; one that does not say so was not."""
    told = [bool(v) for k, v in found.items() if k.startswith("safe")]
    return bool(told) and all(told)


def reason(found: Mapping[str, Any]) -> str:
    """Return in words without numbers why a bench did not meet everything, or was not safe; empty where it was both."""
    why = [] if is_kept_safe(found) else ["not safe"]
    if (error := found.get("error")) is None:
        missed = misses(found)
        return "; ".join([*([f"missed: {', '.join(missed)}"] if missed else []), *why])
    text = re.sub(r"^cycle \d+ \([^)]*\): ", "", error)
    text = re.split(r", the limit|: after |; ", text)[0]
    return "; ".join([re.sub(r"-?\b\d+(\.\d+)?(e[+-]?\d+)?\b", "#", text), *why])
