"""What other identification makes of the same rows: ARX by least squares and N4SID (SIPPY) beside `mccd identify`.

    python -m benchmarks.peers_identify [--seed N] [--only TEXT] [--measured FOLDER] [--diagnose] [--out FOLDER]

Plants are drawn by seed (`peers_plants`), simulated by scipy, written as CSV, imported by `mccd import` and identified
by `mccd identify` without any option. The peers (`peers_models`) get the same fitted rows, and all are judged by the
free run on the same held-out rows: 100 · rms(y − simulated) ÷ rms(y − mean), of the worst output. FOLDER holds the
measured mirror's arrays (`u_200mV_train.npy` …). `--diagnose` asks `mccd diagnose` for the error of that model on the
same rows. N4SID is the extra `peers-identify`; absent, it is left out. The result goes to benchmarks/results/.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from benchmarks.peers_models import StateSpace, arx_models, free_run_error, n4sid_models
from benchmarks.peers_plants import Record, maker
from campaigns.version import tool_commit, tool_version
from sim_backend.model import load_model

Array = NDArray[np.float64]
Parts = Sequence[tuple[Array, Array]]

AIM = 1.05
"""What the free run may miss, over the best peer's."""

MIRROR_HZ = 6400.0
OURS = "mccd identify"
PEERS: dict[str, tuple[str, Callable[[Parts], Iterator[tuple[str, StateSpace]]]]] = {
    "ARX": ("numpy", arx_models),
    "N4SID": ("sippy_unipi", n4sid_models),
}


def main(words: Sequence[str] | None = None) -> int:
    """Compare on drawn plants and on the measured mirror and write the result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="cases whose name contains this")
    parser.add_argument("--measured", type=Path, help="folder of the measured mirror's arrays")
    parser.add_argument("--diagnose", action="store_true", help="ask `mccd diagnose` for the same number")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results", help="folder of the result")
    options = parser.parse_args(words)
    there = {n: made for n, (package, made) in PEERS.items() if importlib.util.find_spec(package) is not None}
    absent = sorted(set(PEERS) - set(there))
    for name in absent:
        print(f"{name} is not installed and left out", file=sys.stderr)
    rows = []
    for name, make in maker().items():
        if options.only in name:
            rows.append(_simulated(name, make(options.seed), there, options.diagnose))
            print(_line(rows[-1]), flush=True)
    if options.measured is not None:
        for level in ("100mV", "200mV", "300mV"):
            if options.only in f"mirror {level}":
                rows.append(_mirror(options.measured, level, there))
                print(_line(rows[-1]), flush=True)
    today = datetime.now(UTC).date().isoformat()
    result = {
        "version": tool_version(),
        "commit": tool_commit(),
        "peers": {p: version(p) for p, _ in PEERS.values() if importlib.util.find_spec(p) is not None},
        "date": today,
        "command": _command(options),
        "absent": absent,
        "cases": rows,
    }
    target = options.out / f"peers-identify-{today}.json"
    target.write_text(json.dumps(result, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    target.with_suffix(".md").write_text(page(result), encoding="utf-8")
    print(target)
    return 0


def _command(options: argparse.Namespace) -> str:
    words = [f"python -m benchmarks.peers_identify --seed {options.seed}"]
    words += [f"--only '{options.only}'"] if options.only else []
    words += ["--measured FOLDER"] if options.measured is not None else []
    return " ".join([*words, *(["--diagnose"] if options.diagnose else [])])


def _simulated(name: str, record: Record, there: dict[str, Any], diagnose: bool) -> dict[str, Any]:
    u, y, cut = record.inputs, record.outputs, record.fitted
    # of what repeats, identification tries the last period alone
    held = slice(u.shape[0] - record.period if record.period else cut, None)
    peers = _peers([(u[:cut], y[:cut])], [(u[held], y[held])], there)
    with tempfile.TemporaryDirectory() as folder:
        header = ",".join([f"u{i}" for i in range(u.shape[1])] + [f"y{i}" for i in range(y.shape[1])])
        np.savetxt(Path(folder) / "run.csv", np.hstack([u, y]), "%.12g", ",", header=header, comments="")
        (Path(folder) / "map.toml").write_text(tomli_w.dumps(map_of(record)), encoding="utf-8")
        ours = _ours(Path(folder), diagnose)
    return _row(name, ours, peers, 100.0 * float(np.max(record.floor)))


def map_of(record: Record) -> dict[str, Any]:
    """Return the map by which `mccd import` reads a simulated record."""
    log: dict[str, Any] = {"test": "peers", "source": "run.csv", "sample_rate_hz": record.rate_hz}
    if record.period:
        log["period"] = record.period
    channels = {}
    for sign, unit, role, values in (("u", "V", "input", record.inputs), ("y", "m", "output", record.outputs)):
        for i in range(values.shape[1]):
            channels[f"{sign}{i}"] = {"select": f"{sign}{i}", "unit": unit, "role": role, "dof": f"{sign}{i}"}
    parts = {"fitted": [0, record.fitted], "held-out": [record.fitted, record.inputs.shape[0]]}
    return {"log": log, "channels": channels, "segments": parts}


def _mirror(folder: Path, level: str, there: dict[str, Any]) -> dict[str, Any]:
    """Compare on one level of the measured mirror: all fitted rows, and the last period of each test record."""
    train, test = ([np.load(folder / f"{s}_{level}_{part}.npy") for s in "uy"] for part in ("train", "test"))

    def parts(record: list[Array], periods: slice) -> list[tuple[Array, Array]]:
        """Take (sample, channel, realisation, period) apart into one record (n, channels) for each realisation."""
        each = [[x[:, :, r, periods].transpose(2, 0, 1).reshape(-1, x.shape[1]) for x in record] for r in
                range(record[0].shape[2])]  # fmt: skip
        return [(one[0], one[1]) for one in each]

    peers = _peers(parts(train, slice(None)), parts(test, slice(-1, None)), there)
    with tempfile.TemporaryDirectory() as place:
        for file in folder.resolve().glob(f"*_{level}_*.npy"):
            (Path(place) / file.name).symlink_to(file)
        document: dict[str, Any] = {
            "log": {"test": "mirror", "sample_rate_hz": MIRROR_HZ, "axes": ["sample", "realisation", "period"]},
            "channels": {
                f"{sign}{i}": {"source": sign, "select": f"{sign}[:, {i}]", "unit": unit, "role": role,
                               "dof": f"{sign}{i}"}
                for sign, unit, role in (("u", "V", "input"), ("y", "m", "output")) for i in range(3)
            },
            "parts": [
                {"label": label, "sources": {s: f"{s}_{level}_{part}.npy" for s in "uy"}}
                for label, part in (("fitted", "train"), ("held-out", "test"))
            ],
        }  # fmt: skip
        (Path(place) / "map.toml").write_text(tomli_w.dumps(document), encoding="utf-8")
        ours = _ours(Path(place), False)
    return _row(f"mirror {level}", ours, peers, None)


def _peers(fitted: Parts, held: Parts, there: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return what each peer got: its error in per cent, its own words and its processor time."""
    found = {}
    for made in there.values():
        started = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of orders that are too high, which the error shows
            for name, model in made(fitted):
                error = np.mean([free_run_error(model, u, y) for u, y in held], axis=0)
                found[name] = {
                    "error": _finite(100.0 * float(np.max(error))),
                    "said": model.words,
                    "seconds": time.process_time() - started,
                }
                started = time.process_time()
    return found


def _ours(folder: Path, diagnose: bool) -> dict[str, Any]:
    """Return what the commands get from the map in a folder; a command that fails leaves its last line."""
    _mccd(folder, "import", "map.toml", "-o", "run.h5", "--allow-outside")  # the data are links
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    printed = _mccd(folder, "identify", "--log", "run.h5", "-o", "m.toml", "--json")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if isinstance(printed, str):
        return {"error": None, "said": printed, "seconds": seconds}
    found = printed["identification"]
    per_output = [list(one["per_output"].values()) for one in found["held_out"]]
    error = _finite(100.0 * float(np.max(np.mean(per_output, axis=0)))) if per_output else None
    shown = ", ".join(f"{mode['frequency_hz']:.4g}" for mode in found["modes"])
    model = load_model(folder / "m.toml")
    late = [f"{late:.3g}" for late in (model.linear().delay_s * model.sample_rate_hz).tolist() if late]
    said = f"{found['method']}: {shown} Hz" + (f"; late by {', '.join(late)} samples" if late else "")
    return {"error": error, "said": said, "seconds": seconds} | (_diagnosed(folder) if diagnose else {})


def _diagnosed(folder: Path) -> dict[str, Any]:
    """Return what `mccd diagnose` says of the same model on the same rows."""
    printed = _mccd(folder, "diagnose", "run.h5", "--model", "m.toml", "-o", "out", "--json")
    if isinstance(printed, str):
        return {"diagnosed": printed}
    each = [one["rms_before"] for one in (printed.get("gain") or {}).get("outputs", [])]
    return {"verdict": printed["verdict"], "diagnosed": _finite(100.0 * max(each)) if each else None}


def _mccd(folder: Path, *arguments: str) -> Any:
    """Return what a command prints as JSON, or its last line on standard error."""
    root = str(Path(__file__).resolve().parents[1])
    home = {"PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
    command = [sys.executable, "-m", "mccdcli", *arguments]
    done = subprocess.run(command, cwd=folder, env=os.environ | home, capture_output=True, text=True, check=False)
    if "--json" in arguments and done.stdout.startswith("{"):
        return json.loads(done.stdout)
    return (done.stderr.strip() or "nothing").splitlines()[-1]


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _row(name: str, ours: dict[str, Any], peers: dict[str, dict[str, Any]], floor: float | None) -> dict[str, Any]:
    """Return a line of the table; the ratio is None where either side has no number."""
    best = min((one["error"] for one in peers.values() if one["error"] is not None), default=None)
    ratio = ours["error"] / best if best and ours["error"] is not None else None
    return {"case": name, "floor": floor, "found": {OURS: ours, **peers}, "best_peer": best, "ratio": ratio}


def _line(row: dict[str, Any]) -> str:
    def shown(value: float | None) -> str:
        return "none" if value is None else f"{value:.4g}"

    errors = "  ".join(f"{name} {shown(one['error'])}" for name, one in row["found"].items())
    return (
        f"{row['case']:34s} ratio {shown(row['ratio']):6s} floor {shown(row['floor'])}  {errors}"
        f"  [{row['found'][OURS]['seconds']:.1f} s; {row['found'][OURS]['said']}]"
    )


def page(result: dict[str, Any]) -> str:
    """Return a result as Markdown: one line per case."""
    rows = result["cases"]
    names = list(dict.fromkeys(name for row in rows for name in row["found"]))
    reached = sum(row["ratio"] is not None and row["ratio"] <= AIM for row in rows)
    lines = [
        f"# Identification beside ARX and N4SID, {result['date']}",
        "",
        f"mccd {result['version']} (commit {result['commit']}); "
        + ", ".join(f"{name} {number}" for name, number in result["peers"].items())
        + ". Made by:",
        "",
        "```",
        result["command"],
        "```",
        "",
        "Errors are those of the free run on the held-out rows, rms over rms of the reading in per cent, of the worst "
        "output; *true* is the plant itself, so the noise. The ratio is to the best peer. "
        f"At most {AIM} times the best peer's: {reached} of {len(rows)} cases.",
        "",
        "| case | true | " + " | ".join(names) + " | ratio | modes, Hz | processor time, s |",
        "| --- " * (len(names) + 5) + "|",
    ]
    for row in rows:
        errors = [_cell((row["found"].get(name) or {}).get("error")) for name in names]
        own = row["found"][OURS]
        cells = [row["case"], _cell(row["floor"]), *errors, _cell(row["ratio"]), own["said"], f"{own['seconds']:.1f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


if __name__ == "__main__":
    sys.exit(main())
