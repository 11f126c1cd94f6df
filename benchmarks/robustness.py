"""How many benches meet every requirement: benches drawn about the one as built, each with the same controllers.

    python -m benchmarks.robustness --controller design/controller.toml --benches 1000
    python -m benchmarks.robustness --controller design/controller.toml --benches 20 --far

The controller was designed once, on logs of the bench as built. Every drawn bench has other modes, damping, gains,
iron, noise and temperature; the paper's strategies are played on the same benches with the same noise. Each bench is
one line of a file, so that a run that was stopped goes on where it was. Exit code 1 if the goal is missed. A run is
safe unless an axis strays after its step, or the coils dissipate too much, for more than three cycles in a row.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

import msgspec
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
from campaigns.plans import make_plan
from campaigns.strategies.controller import load_controller
from campaigns.version import tool_commit, tool_version
from sim_backend.bench import Limits, Record
from sim_backend.errors import CheckError, MccdError
from sim_backend.model import EffectEntry, Model, Quantity, Value, load_model, number
from sim_backend.simbench import SimBench

Array = NDArray[np.float64]

GOAL = 0.99
CYCLES = 12
SLOW_CYCLES = 5
SLOW_ALPHA_DEG = 120.0
"""A direction in which both axes move."""

AXES = {"theta_x": 0.0, "theta_y": 90.0}
COLD_K, WARM_K, FAR_COLD_K = 63.5, 77.0, 63.0
STRAY_RAD, STEP_S, UNSAFE_CYCLES = 50e-6, 5e-3, 3


@dataclass(frozen=True)
class Spread:
    """Relative standard deviations of what is drawn; temperature is uniform over the thermal range."""

    frequency: float = 0.001
    damping: float = 0.05
    participation: float = 0.02
    suspension: float = 0.005
    iron: float = 0.05
    noise: float = 0.05
    sensor_gain: float = 0.001
    modulus_per_k: float = -1e-4

    def times(self, scale: float) -> Spread:
        """Return the spread with every standard deviation `scale` times as large."""
        return Spread(**{k: v if k == "modulus_per_k" else scale * v for k, v in asdict(self).items()})


def drawn_bench(model: Model, spread: Spread, rng: np.random.Generator) -> tuple[Model, dict[str, float]]:
    """Return a bench within `spread` of `model`, at a temperature of its own, and what was drawn of the largest."""
    kelvin = float(rng.uniform(COLD_K, WARM_K))
    # frequencies go with the root of the modulus
    cooled = 1.0 + 0.5 * spread.modulus_per_k * (kelvin - WARM_K)

    def scaled(value: Value, std: float, factor: float = 1.0) -> Value:
        return Quantity(value=number(value) * factor * (1.0 + std * rng.standard_normal()), origin="assumed")

    modes = []
    for mode in model.modes:
        held = "suspension" in mode.label  # the bench has an effect of its own for how its springs soften
        std = np.hypot(spread.frequency, spread.suspension if held else 0.0)
        modes.append(
            msgspec.structs.replace(
                mode,
                frequency_hz=scaled(mode.frequency_hz, float(std), 1.0 if held else cooled),
                decay_rate_1_s=scaled(mode.decay_rate_1_s, spread.damping),
                input={k: scaled(v, spread.participation) for k, v in mode.input.items()},
            )
        )
    relative = {
        "jiles-atherton": ("size", spread.iron),
        "amplifier-noise": ("std", spread.noise),
        "sensor-noise": ("std", spread.noise),
    }

    def drawn(entry: EffectEntry) -> EffectEntry:
        parameters = dict(entry.parameters)
        if entry.effect in relative:
            name, std = relative[entry.effect]
            parameters[name] = scaled(parameters[name], std)
        if entry.effect == "sensor-gain":
            parameters["relative"] = number(parameters["relative"]) + spread.sensor_gain * rng.standard_normal()
        return msgspec.structs.replace(entry, parameters=parameters)

    assert model.hardware is not None
    hardware = msgspec.structs.replace(model.hardware, cold_finger_k=kelvin)
    bench = msgspec.structs.replace(model, modes=modes, effects=[drawn(e) for e in model.effects], hardware=hardware)
    return bench, {"cold_finger_k": kelvin}


def far_bench(model: Model, rng: np.random.Generator) -> tuple[Model, dict[str, float]]:
    """Return a bench as far from `model` as a design must survive, and what was drawn.

    Uniform: every mode's frequency ± 1 %, damping ± 20 %, delay up to a sample, temperature; log-uniform: amplifier 1
    to 5 kHz, noise and iron × 0.5 to 2.
    """
    drawn = {
        "cold_finger_k": float(rng.uniform(FAR_COLD_K, WARM_K)),
        "delay_samples": float(rng.uniform(0.0, 1.0)),
        "amplifier_hz": float(1000.0 * 5.0 ** rng.uniform()),
    }
    factor = {name: float(2.0 ** rng.uniform(-1.0, 1.0)) for name in ("noise", "iron")}
    modes = [
        msgspec.structs.replace(
            mode,
            frequency_hz=number(mode.frequency_hz) * (1.0 + rng.uniform(-0.01, 0.01)),
            decay_rate_1_s=number(mode.decay_rate_1_s) * (1.0 + rng.uniform(-0.2, 0.2)),
        )
        for mode in model.modes
    ]
    scaled = {"jiles-atherton": ("size", "iron"), "amplifier-noise": ("std", "noise"), "sensor-noise": ("std", "noise")}

    def changed(entry: EffectEntry) -> EffectEntry:
        if entry.effect not in scaled:
            return entry
        name, kind = scaled[entry.effect]
        value = number(entry.parameters[name]) * factor[kind]
        return msgspec.structs.replace(entry, parameters={**entry.parameters, name: value})

    effects = [changed(entry) for entry in model.effects]
    for dof in AXES:
        seconds = drawn["delay_samples"] / model.sample_rate_hz
        effects.append(EffectEntry(effect="delay", where=dof, parameters={"seconds": seconds}))
        lag: dict[str, Value] = {"time_constant_s": 1.0 / (2.0 * np.pi * drawn["amplifier_hz"])}
        effects.append(EffectEntry(effect="amplifier-lag", where=dof, parameters=lag))
    assert model.hardware is not None
    hardware = msgspec.structs.replace(model.hardware, cold_finger_k=drawn["cold_finger_k"])
    return msgspec.structs.replace(model, modes=modes, effects=effects, hardware=hardware), drawn | factor


class StoppedError(CheckError):
    """The watch of a chop stopped it; `safe` tells whether it did so in time."""

    def __init__(self, why: str, safe: bool) -> None:
        super().__init__(why)
        self.safe = safe


def is_safe(records: list[Record], limits: Limits) -> bool:
    """Tell whether no axis strays after its step, and the power keeps its limit, but for UNSAFE_CYCLES in a row."""
    bad, longest, coil = 0, 0, limits.coil
    assert coil is not None
    for record in records:
        segment, settings = record.segment, record.segment.settings
        period, dwell = segment.reference.shape[0], int(settings["dwell_samples"])
        skip = round(STEP_S * 1e4)
        for first in range(0, segment.n_samples - period + 1, period):
            rows = slice(first, first + period)
            command = np.stack([record.channels[f"command_{dof}"][rows] for dof in (*AXES, "z")], axis=1)
            power = np.sum(
                (coil.force_constant_n_a / coil.steepness_n_sqrt_w * command @ limits.to_current.T) ** 2, axis=1
            )
            worst = 0.0
            for i, dof in enumerate(AXES):
                error = segment.reference[:, i] - record.channels[dof][rows]
                by_dwell = np.roll(error, -int(settings["position_2_at"])).reshape(2, dwell)
                worst = max(worst, float(np.max(np.abs(by_dwell[:, skip:]))))
            bad = bad + 1 if power.mean() > POWER_W or worst > STRAY_RAD else 0
            longest = max(longest, bad)
    return longest <= UNSAFE_CYCLES


def played(
    bench: Model, seed: int, plan: str, **settings: object
) -> tuple[dict[str, Array], dict[str, float | str], bool]:
    """Return the channels of the chop itself, from a move to position 2 on, its settings, and whether all was safe.

    Raises StoppedError where the watch stops it, as a run does.
    """
    sim = SimBench(bench, seed)
    made = make_plan(plan, settings)
    watch, parts, every = made.watch(sim), [], []
    for segment in made.segments(sim):
        record = sim.play(segment if watch is None else watch.asked(segment))
        every.append(record)
        if watch is not None and (why := watch.failure(segment, record)):
            if (found := watch.fallback(segment)) is not None:
                every.append(sim.play(watch.asked(found[0])))
            raise StoppedError(why, is_safe(every, sim.limits))
        if segment.settings["phase"] == "chop":
            parts.append(record)
    first = int(parts[0].segment.settings["position_2_at"])
    channels = {name: np.concatenate([p.channels[name] for p in parts])[first:] for name in parts[0].channels}
    return channels, dict(parts[0].segment.settings), is_safe(every, sim.limits)


def fast(bench: Model, seed: int, axis: str, **settings: object) -> dict[str, float]:
    """Return settling, power, current and parasitic motion of a 5 Hz chop of one axis."""
    channels, own, safe = played(bench, seed, "settling", alpha_deg=AXES[axis], cycles=CYCLES, **settings)
    dwell = int(own["dwell_samples"])
    angle = channels[axis][: channels[axis].size // (2 * dwell) * 2 * dwell].reshape(-1, 2, dwell)
    mean = angle[1:].mean(axis=0)
    settled = settling(mean, 1e4, np.array([own["to_rad"], own["from_rad"]]))
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


def strategies(controller: str) -> dict[str, Callable[[Model, int], dict[str, float]]]:
    """Return what is judged: this project's controller, and the paper's strategies as its Table 6.6 uses them."""

    def all_of(quick: str, calm: str, **settings: object) -> Callable[[Model, int], dict[str, float]]:
        def judged(bench: Model, seed: int) -> dict[str, float]:
            out = slow(bench, seed, strategy=calm, **settings)
            for axis in AXES:
                out |= fast(bench, seed + 1, axis, strategy=quick, **settings)
            return out

        return judged

    return {
        "this project": all_of("designed", "designed", controller=controller),
        "paper, hybrid": all_of("hybrid", "hybrid"),
        "paper, hybrid and repetitive": all_of("repetitive", "hybrid"),
    }


def trial(index: int, seed: int, spread: Spread | None, controller: str) -> dict[str, object]:
    """Return one bench's results under every strategy; one that is stopped or cannot be played meets nothing.

    Without a spread the bench is one of `far_bench`.
    """
    rng, model = np.random.default_rng([seed, index]), load_model("as-built")
    bench, drawn = far_bench(model, rng) if spread is None else drawn_bench(model, spread, rng)
    results: dict[str, object] = {"index": index, **drawn}
    for name, judge in strategies(controller).items():
        try:
            found = judge(bench, 2 * index)
        except MccdError as error:
            results[name] = {"error": str(error), "safe": isinstance(error, StoppedError) and error.safe}
            continue
        results[name] = {k: v if np.isfinite(v) else None for k, v in found.items()}
    return results


def misses(found: dict[str, float | None]) -> list[str]:
    """Return the requirements that a result misses; a number that is none misses its own."""
    return [k for k, limit in LIMITS.items() if (v := found.get(k)) is None or not v <= limit]


def summary(rows: list[dict[str, dict[str, float | None]]]) -> dict[str, object]:
    """Return for every strategy the part of benches that meet everything, with its interval, and what was missed."""
    out: dict[str, object] = {}
    for name in strategies(""):
        all_missed = [misses(row[name]) for row in rows]
        met, n = sum(not m for m in all_missed), len(rows)
        values = {k: [v for row in rows if (v := row[name].get(k)) is not None] for k in (*LIMITS, "inside")}
        out[name] = {
            "met": met,
            "of": n,
            "fraction": met / n,
            "ci95": wilson(met, n),
            "safe": sum(all(v for k, v in row[name].items() if k.startswith("safe")) for row in rows),
            "missed": {k: sum(k in m for m in all_missed) for k in LIMITS},
            "median": {k: float(np.median(v)) for k, v in values.items() if v},
            "worst": {k: float(np.max(v) if k != "inside" else np.min(v)) for k, v in values.items() if v},
        }
    return out


def wilson(met: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a fraction (Wilson, 1927)."""
    z = 1.959964
    p = met / n
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return float(centre - half), float(centre + half)


def main(arguments: list[str] | None = None) -> int:
    """Play what is missing of the trials, and write the summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--controller", required=True)
    parser.add_argument("--benches", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scale", type=float, default=1.0, help="this many times the spread")
    parser.add_argument("--far", action="store_true", help="benches as far as a design must survive instead")
    parser.add_argument("--out", type=Path, default=None, help="summary; its lines stand beside it as .jsonl")
    given = parser.parse_args(arguments)
    load_controller(given.controller)  # one that is none would cost every trial
    spread, now = None if given.far else Spread().times(given.scale), datetime.now(UTC)
    out: Path = given.out or Path(__file__).parent / "results" / f"robustness-{now:%Y-%m-%d}.json"
    lines = out.with_suffix(".jsonl")
    rows = [json.loads(text) for text in lines.read_text().splitlines()] if lines.exists() else []
    started = time.monotonic()
    with lines.open("a") as file:
        for index in range(len(rows), given.benches):
            rows.append(trial(index, given.seed, spread, given.controller))
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
            if index % 10 == 0:
                print(f"{index + 1} of {given.benches}, {time.monotonic() - started:.0f} s", file=sys.stderr)
    result = {
        "date_utc": f"{now:%Y-%m-%d}",
        "mccd": f"{tool_version()} ({tool_commit()})",
        "python": platform.python_version(),
        "seed": given.seed,
        "spread": "far" if spread is None else asdict(spread),
        "thermal_range_k": [FAR_COLD_K if spread is None else COLD_K, WARM_K],
        "trial": f"{SLOW_CYCLES} cycles at 0.5 Hz and {SLOW_ALPHA_DEG:g}°, {CYCLES} cycles at 5 Hz on each axis",
        "left_out": "the drift over five minutes, the other directions and forms, the lifetime",
        "limits": LIMITS,
        "strategies": summary(rows),
    }
    out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps({k: v["fraction"] for k, v in result["strategies"].items()}))
    return 0 if result["strategies"]["this project"]["fraction"] >= GOAL else 1


if __name__ == "__main__":
    raise SystemExit(main())
