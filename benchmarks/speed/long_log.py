"""A log of 10 GB with every channel of the bench: written, verified, summarised, exported, analysed, and its memory.

A third of it is a chop as the bench recorded it, a third multisines in three realisations, a third noise; both of the
latter with the response of the bench's design model.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from analysis.linear.simulate import periodic_response
from analysis.recorded.chop import chop_phase
from analysis.recorded.drift import drift_of
from analysis.recorded.settle import settle_of
from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared, Target
from benchmarks.speed.commands import Commands, Ran, at_most_mb
from campaigns.log import Channel, LogWriter, read_run
from campaigns.plans import checked_segments, make_plan
from sim_backend.model import load_model
from sim_backend.simbench import SimBench

Array = NDArray[np.float64]
Rows = Mapping[str, Array]

WRITE, VERIFY, SUMMARY, EXPORT = "write with checksums", "mccd log verify", "mccd log summary", "mccd log export (nxs)"
CHOP, PERIODIC, FREE = "drift, stability and settling", "mccd identify, periodic", "mccd identify, free"
READERS = (VERIFY, SUMMARY, EXPORT, CHOP, PERIODIC, FREE)
BYTES, QUICK = 10_000_000_000, 50_000_000
RATE_HZ = 10_000.0
PERIOD, LONG_PERIOD = 10_000, 100_000
MODES = (29.22, 1440.0)
"""The modes of θy in the design model, in Hz: the axis that has no more than these two."""


def chopped() -> tuple[list[Channel], Rows, dict[str, Any]]:
    """Return the channels, ten seconds of a 0.5 Hz chop on the bench as built, and the settings of its segment."""
    bench = SimBench(load_model("as-built"), 0)
    names = tuple(s.name for s in bench.signals if not s.name.startswith("theodolite"))
    *before, last = checked_segments(make_plan("thermal", {"cycles": 5, "frequency_hz": 0.5}), bench)
    for segment in before:
        bench.play(segment)
    record = bench.play(dataclasses.replace(last, record=names))
    return [Channel.of(s) for s in bench.signals if s.name in names], record.channels, dict(last.settings)


def excited(period: int, rng: np.random.Generator, like: Rows) -> Rows:
    """Return periodic noise from 2 to 2000 Hz on all inputs of the design model, with its response."""
    model = load_model("design")
    lines = np.arange(period // 2 + 1)
    f = lines * RATE_HZ / period
    spectrum = np.exp(2j * np.pi * rng.random((lines.size, 3))) * ((f >= 2.0) & (f <= 2000.0))[:, None]
    u = np.fft.irfft(spectrum, period, axis=0)
    u *= np.array([2e-3, 2e-3, 0.02]) / u.std(axis=0)
    y = periodic_response(model.linear().frequency_response(f, RATE_HZ), u)
    y = y + 1e-4 * y.std(axis=0) * rng.standard_normal(y.shape)
    times = -(-100_000 // period)
    rows = {name: np.tile(values[:1], period * times) for name, values in like.items()}
    for i, (into, out) in enumerate(zip(model.inputs, model.outputs, strict=True)):
        rows[f"command_{into.dof}"], rows[out.dof] = np.tile(u[:, i], times), np.tile(y[:, i], times)
    return rows


def contents(chop: Rows, settings: dict[str, Any], rows: int) -> Iterator[tuple[str, dict[str, Any], Rows, int]]:
    """Yield label, settings, a block of rows and how often it is repeated, for each segment of about `rows` in all."""
    rng = np.random.default_rng(1)
    length = next(iter(chop.values())).size
    yield "chop", {**settings, "phase": "chop"}, chop, rows // 3 // length
    for k in range(3):
        block = excited(PERIOD, rng, chop)
        label, given = f"multisine {k}", {"period_samples": PERIOD, "realisation": k}
        yield label, given, block, rows // 9 // next(iter(block.values())).size
    block = excited(LONG_PERIOD, rng, chop)
    yield "noise", {}, block, rows // 3 // next(iter(block.values())).size


def write(path: Path, channels: list[Channel], segments: list[tuple[str, dict[str, Any], Rows, int]]) -> int:
    """Write the log anew, with its checksums, as the runner does; return its rows."""
    path.unlink(missing_ok=True)
    with LogWriter.create(path, channels, test="thermal", bench={"kind": "sim", "name": "long"}) as writer:
        for label, settings, block, times in segments:
            with writer.segment(label, settings):
                for _ in range(times):
                    writer.reserve(next(iter(block.values())).size)
                    writer.append(block)
        return writer.rows


def analyse(path: str) -> None:
    """Print what the chop of a log shows, as JSON; run in a process of its own."""
    with read_run(path) as run:
        drift, stability, settled = drift_of(run), chop_phase(run).stability(), settle_of(run)
    found = {"drift": drift.mean_rad[:, -1].tolist(), "mean": stability.mean_rad.tolist(), "s": settled.settling_s}
    print(json.dumps(found))


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return the writer and the readers; all read the one log, and none is run twice."""
    channels, chop, settings = chopped()
    segments = list(contents(chop, settings, (QUICK if quick else BYTES) // 8 // len(channels)))
    rows = sum(next(iter(block.values())).size * times for _, _, block, times in segments)
    path, commands = folder / "long.h5", Commands(folder)

    def identified(only: str, log: Path = path) -> Ran:
        out = folder / f"{only}.toml"
        out.unlink(missing_ok=True)
        return commands.mccd("identify", "--log", str(log), "--only", only, "-o", str(out), "--json")

    def exported() -> Ran:
        out = folder / "long.nxs"
        out.unlink(missing_ok=True)
        ran = commands.mccd("log", "export", str(path), "-o", str(out))
        with h5py.File(out) as file:
            ends = [[float(file[f"entry/output/{n}"][k]) for k in (0, -1)] for n in ("theta_x", "z")]
        out.unlink()
        return dataclasses.replace(ran, out=json.dumps(ends))

    code = "import sys; from benchmarks.speed.long_log import analyse; analyse(sys.argv[1])"
    work = {
        VERIFY: lambda: commands.mccd("log", "verify", str(path)),
        SUMMARY: lambda: commands.mccd("log", "summary", str(path), "--json"),
        EXPORT: exported,
        CHOP: lambda: commands.python("-c", code, str(path)),
    }
    fits = {PERIODIC: lambda: identified("multisine"), FREE: lambda: identified("noise")}
    work |= {} if quick else fits
    facts: dict[str, Any] = {}
    if not quick:  # the first identification ever compiles its loops, which takes memory of its own
        short = folder / "short.h5"
        write(short, channels, list(contents(chop, settings, 4 * QUICK // 8 // len(channels))))
        facts["MB of a first identification, of 200 MB"] = identified("multisine", short).peak_mb
    writer = Contender(WRITE, lambda: write(path, channels, segments), rows / RATE_HZ, rounds=1, warm=0)
    return Prepared(
        (writer, *(Contender(name, run, rounds=1, warm=0) for name, run in work.items())),
        lambda results: check(results, segments, rows),
        dict.fromkeys(fits, "too slow for a quick look") if quick else {},
        {"bytes": 8 * len(channels) * rows, "channels": len(channels), "simulated seconds": rows / RATE_HZ} | facts,
    )


def check(
    results: Mapping[str, Any], segments: list[tuple[str, dict[str, Any], Rows, int]], rows: int
) -> list[Agreement]:
    """Compare every number with what was written, and identified modes with those of the model behind it."""
    blocks = [(block, times) for _, _, block, times in segments]
    mean = sum(block["theta_x"].sum() * times for block, times in blocks) / rows
    told = next(c for c in json.loads(results[SUMMARY].out)["channels"] if c["name"] == "theta_x")
    ends = [[blocks[0][0][n][0], blocks[-1][0][n][-1]] for n in ("theta_x", "z")]
    settings, chop = segments[0][1], blocks[0][0]
    both = np.stack([chop["theta_x"], chop["theta_y"]], axis=1).reshape(-1, 2, settings["dwell_samples"], 2)
    position = both[:, ::-1, -settings["window_samples"] :].mean(axis=(0, 2))
    seen = json.loads(results[CHOP].out)
    found = {
        VERIFY: (float(results[VERIFY].code), 0.0, "exit code"),
        SUMMARY: (abs(told["mean"] - mean) / abs(mean), 1e-9, "relative, of a mean: rounding"),
        EXPORT: (float(np.max(np.abs(np.array(json.loads(results[EXPORT].out)) - ends))), 0.0, "first and last rows"),
        CHOP: (float(np.max(np.abs(np.array(seen["mean"]) - position))), 1e-15, "mean positions, rad: rounding"),
    }
    # half the width of the lowest mode is 5 Hz, lines lie 0.6 Hz apart, and a Hann window smears over one
    for name, allowed, why in ((PERIODIC, 1e-3, "noise"), (FREE, 1e-2, "noise and the window")):
        if name in results:
            found[name] = modes_error(results[name]), allowed, f"relative, of θy's modes: {why}"
    return [Agreement(name, *told) for name, told in found.items()]


def modes_error(ran: Ran) -> float:
    """Return by how much the modes of θy are missed, at worst, relative to themselves."""
    found = np.array([mode["frequency_hz"] for mode in json.loads(ran.out)["identification"]["modes"]])
    return float(max(np.min(np.abs(found / hz - 1.0)) for hz in MODES))


BENCHMARK = Benchmark(
    "long-log",
    "one log of 10 GB with every channel of the bench as built, in one process after the other",
    prepare,
    (
        Target(f"{WRITE}: times real time", 50.0, "×", (WRITE,), lambda turn: 1.0 / turn.seconds[WRITE]),
        *(at_most_mb(name, 500.0) for name in READERS),
    ),
    {},
)
