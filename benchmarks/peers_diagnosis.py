"""What sparse regression makes of the same blind cases: FROLS (SysIdentPy) and discrepancy-SINDy (PySINDy).

    python -m benchmarks.peers_diagnosis DIR [--cases N] [--out FOLDER] [--made-by COMMAND ...]

DIR is a challenge that `mccd challenge make` wrote. Taken are its one-axis cases with one effect or none; the truth is
opened to score. Both peers get the samples that may be fitted, SINDy the nominal model as well, and both predict the
held-out samples in free run. What `mccd challenge run` got of the same cases stands beside them. Both run with plain
settings, not tuned to a case. They are the extra `peers-diagnosis`, in an environment of its own; one that is absent is
left out. The result goes to benchmarks/results/ as JSON and as a page.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from analysis.challenge.judge import judge
from analysis.challenge.run import DIAGNOSIS, RESULTS, cases_of, diagnosed_by, was_run
from analysis.challenge.truth import Case, reveal
from campaigns.log import read_run
from campaigns.version import tool_commit, tool_version
from sim_backend.linear import ModalModel, discretise
from sim_backend.model import load_model

Array = NDArray[np.float64]

AXIS = "theta_x"
ROWS = 6000
"""Samples that FROLS is given: its matrix of candidate terms grows with them and its search is not compiled."""

TERMS: dict[str, tuple[Callable[..., Array], str | None]] = {
    "1": (lambda x, v, u: np.ones_like(x), "constant-torque"),
    "x": (lambda x, v, u: x, "stiffness-shift"),
    "v": (lambda x, v, u: v, "damping-shift"),
    "u": (lambda x, v, u: u, "actuator-gain"),
    "x^2": (lambda x, v, u: x**2, None),
    "x^3": (lambda x, v, u: x**3, "cubic-stiffness"),
    "x v": (lambda x, v, u: x * v, None),
    "v^3": (lambda x, v, u: v**3, None),
    "x u": (lambda x, v, u: x * u, "position-dependent-force-constant"),
    "x^2 u": (lambda x, v, u: x**2 * u, "position-dependent-force-constant"),
    "sign v": (lambda x, v, u: np.sign(v), "coulomb-friction"),
    "sign u": (lambda x, v, u: np.sign(u), "dead-zone"),
    "u^3": (lambda x, v, u: u**3, "amplifier-saturation"),
}
"""SINDy's candidate terms of position, rate and command, each of order one, and the cause that each would stand for."""


@dataclass(frozen=True)
class Data:
    """One case: command and reading (n,), which samples may be fitted, and the nominal model."""

    u: Array
    y: Array
    fitted: NDArray[np.bool_]
    nominal: ModalModel
    rate_hz: float


@dataclass(frozen=True)
class Found:
    """What a method made of a case: held-out error (rms ÷ rms), number of terms, their causes, processor time."""

    error: float
    terms: int
    causes: tuple[str, ...]
    seconds: float


def data_of(case: Path) -> Data:
    """Return the last run of a case that has held-out samples."""
    for path in sorted(case.glob("run-*.h5"), reverse=True):
        with read_run(path) as run:
            held_out = [s for s in run.segments if s.held_out]
            if held_out:
                fitted = np.ones(run.rows, dtype=bool)
                for s in held_out:
                    fitted[s.start : s.stop] = False
                model = load_model(case / "nominal.toml")
                command, reading = run.read(f"command_{AXIS}"), run.read(AXIS)
                return Data(command, reading, fitted, model.linear(), run.sample_rate_hz)
    raise SystemExit(f"{case} has no held-out samples")


def simulated(model: ModalModel, u: Array, rate_hz: float) -> Array:
    """Return the linear response (n,) to a held command, from rest, as a sum of modes by their difference equations."""
    from scipy.signal import lfilter, ss2tf

    exact = discretise(model, rate_hz)
    out = np.zeros_like(u)
    for a, b, c in zip(exact.a, exact.b[:, :, 0], exact.c[0], strict=True):
        numerator, denominator = ss2tf(a, b[:, None], c[None], np.zeros((1, 1)))
        out += lfilter(numerator[0], denominator, u)
    return out


def error_of(data: Data, predicted: Array) -> float:
    """Return the held-out error; infinite when the prediction ran away."""
    kept = ~data.fitted
    if not np.all(np.isfinite(predicted[kept])):
        return float("inf")
    return float(np.sqrt(np.mean((data.y[kept] - predicted[kept]) ** 2)) / np.std(data.y[kept]))


def nominal(data: Data) -> Found:
    """Return what the nominal model alone predicts."""
    started = time.process_time()
    predicted = simulated(data.nominal, data.u, data.rate_hz)
    return Found(error_of(data, predicted), 0, (), time.process_time() - started)


def frols(data: Data) -> Found:
    """Return a polynomial NARX model of degree 3 with four lags, its terms by FROLS and Akaike's criterion."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    started = time.process_time()
    size_u, size_y = np.std(data.u[data.fitted]), np.std(data.y[data.fitted])
    u, y = (data.u / size_u)[:, None], (data.y / size_y)[:, None]
    last = int(np.flatnonzero(data.fitted)[-1]) + 1
    rows = slice(max(last - ROWS, 0), last)
    model = FROLS(
        ylag=4, xlag=4, n_info_values=15, estimator=LeastSquares(), basis_function=Polynomial(degree=3), err_tol=None
    )
    model.fit(X=u[rows], y=y[rows])
    begin = int(np.flatnonzero(~data.fitted)[0]) - 4
    predicted = np.full(data.y.size, np.nan)
    predicted[begin:] = model.predict(X=u[begin:], y=y[begin:])[:, 0] * size_y
    return Found(error_of(data, predicted), len(model.final_model), (), time.process_time() - started)


def sindy(data: Data) -> Found:
    """Return the nominal suspension plus terms found by SINDy in what its equation of motion leaves.

    The other modes' nominal response is taken off first; derivatives are of a local polynomial. The threshold is the
    one of five that predicts the last fifth of the fitted samples best.
    """
    import pysindy

    started = time.process_time()
    m = int(np.argmax(np.abs(data.nominal.c[0] * data.nominal.b[:, 0]) / data.nominal.omega_rad_s**2))
    omega, sigma = data.nominal.omega_rad_s[m], data.nominal.sigma_1_s[m]
    gain = float(data.nominal.c[0, m] * data.nominal.b[m, 0])
    rest = simulated(_without(data.nominal, m), data.u, data.rate_hz)
    size = float(np.std(data.y[data.fitted]))
    position, rate, acceleration = (
        savgol_filter(data.y - rest, 15, 4, deriv=k, delta=1.0 / data.rate_hz) for k in range(3)
    )
    x, v, u = position / size, rate / (omega * size), gain * data.u / (omega**2 * size)
    missing = (acceleration + 2.0 * sigma * rate + omega**2 * position - gain * data.u) / (omega**2 * size)
    features = np.column_stack([term(x, v, u) for term, _ in TERMS.values()])
    train = data.fitted.copy()
    train[int(0.8 * np.flatnonzero(train)[-1]) :] = False
    check = data.fitted & ~train

    def predicted(weights: Array) -> Array:
        return _free_run(weights, u, omega, sigma, data.rate_hz) * size + rest

    best: tuple[float, Array] = (np.inf, np.zeros(len(TERMS)))
    for threshold in (1e-4, 3e-4, 1e-3, 3e-3, 1e-2):
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=1e-6)
        optimizer.fit(features[train], missing[train][:, None])
        weights = np.asarray(optimizer.coef_[0], dtype=float)
        miss = float(np.mean((data.y[check] - predicted(weights)[check]) ** 2))
        if miss < best[0]:
            best = (miss, weights)
    kept = [name for name, w in zip(TERMS, best[1], strict=True) if w != 0.0]
    causes = tuple(sorted({TERMS[name][1] or "?" for name in kept}))
    return Found(error_of(data, predicted(best[1])), len(kept), causes, time.process_time() - started)


def _without(model: ModalModel, m: int) -> ModalModel:
    b = model.b.copy()
    b[m] = 0.0
    return model.with_(b=b)


def _free_run(weights: Array, u: Array, omega: float, sigma: float, rate_hz: float) -> Array:
    """Return the position (n,) of the suspension with the found terms, by half-implicit Euler, eight steps a sample."""
    h, terms = omega / rate_hz / 8.0, [term for term, _ in TERMS.values()]
    active = [(w, term) for w, term in zip(weights, terms, strict=True) if w != 0.0]
    out, x, v = np.empty(u.size), np.zeros(1), np.zeros(1)
    for k in range(u.size):
        out[k] = x[0]
        now = u[k : k + 1]
        for _ in range(8):
            push = sum((w * term(x, v, now) for w, term in active), np.zeros(1))
            v = v + h * (now + push - x - 2.0 * sigma / omega * v)
            x = x + h * v
        if not abs(x[0]) < 1e3:
            out[k:] = np.nan
            break
    return out


PEERS = ("sysidentpy", "pysindy")
METHODS: dict[str, tuple[str, Callable[[Data], Found]]] = {
    "nominal model": ("numpy", nominal),
    "FROLS (SysIdentPy)": (PEERS[0], frols),
    "discrepancy-SINDy (PySINDy)": (PEERS[1], sindy),
}


def ours(folder: Path, name: str, case: Case) -> dict[str, object] | None:
    """Return what `mccd challenge run` got for a case as a row of the table, None when it was not run."""
    if not was_run(folder, name):
        return None
    judged, path = judge(folder, name, case), folder / RESULTS / name / DIAGNOSIS
    said = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    right = judged.right if case.effects else judged.verdict == "consistent"
    causes = [cause["effect"] for cause in said.get("causes", [])]
    error = (said.get("gain") or {}).get("rms_after")
    return {
        "verdict": judged.verdict,
        "right": right,
        "causes": causes,
        "error": error,
        "seconds": judged.outcome.cpu_s,
    }


def main(words: Sequence[str] | None = None) -> int:
    """Compare the methods on a challenge and write the result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=10, help="at most so many cases")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results", help="folder of the result")
    parser.add_argument("--made-by", action="append", default=[], metavar="COMMAND", help="to print before this one")
    options = parser.parse_args(words)
    there = {n: m for n, (package, m) in METHODS.items() if importlib.util.find_spec(package) is not None}
    absent = sorted(set(METHODS) - set(there))
    for name in absent:
        print(f"{name} is not installed and left out", file=sys.stderr)
    truth = reveal(options.folder).cases
    chosen = [n for n in cases_of(options.folder) if truth[n].axes == 1 and truth[n].stratum in ("one", "none")]
    rows = [_row(options.folder, name, truth[name], there) for name in chosen[: options.cases]]
    today = datetime.now(UTC).date().isoformat()
    itself = f"python -m benchmarks.peers_diagnosis {options.folder} --cases {options.cases}"
    result = {
        "version": tool_version(),
        "commit": tool_commit(),
        "diagnosed_by": _diagnosed_by(options.folder, chosen[: options.cases]),
        "peers": {package: version(package) for package in PEERS if importlib.util.find_spec(package) is not None},
        "date": today,
        "commands": [*options.made_by, itself],
        "absent": absent,
        "cases": rows,
    }
    target = options.out / f"peers-diagnosis-{today}.json"
    target.write_text(json.dumps(result, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    target.with_suffix(".md").write_text(page(result), encoding="utf-8")
    print(target)
    return 0


def _diagnosed_by(folder: Path, names: Sequence[str]) -> str | None:
    done = [name for name in names if was_run(folder, name)]
    return diagnosed_by(folder, done) if done else None


def _row(folder: Path, name: str, case: Case, methods: dict[str, Callable[[Data], Found]]) -> dict[str, Any]:
    data = data_of(folder / "cases" / name)
    hidden = [e.effect for e in case.effects]
    found = {}
    for method, run in methods.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of ill-conditioned terms and of runs that diverge, which the error shows
            result = run(data)
        found[method] = {**asdict(result), "error": result.error if np.isfinite(result.error) else None}
        print(
            f"{name} {'+'.join(hidden) or 'none':34s} {method:28s} error / truth's "
            f"{result.error / case.held_out_floor:10.2f}  {result.terms:3d} terms  {', '.join(result.causes)}"
        )
    return {
        "case": name,
        "shape": case.shape,
        "hidden": hidden,
        "times_naming": [e.size / e.naming_limit for e in case.effects],
        "floor": case.held_out_floor,
        "ours": ours(folder, name, case),
        "found": found,
    }


def page(result: dict[str, Any]) -> str:
    """Return a result as Markdown: one line per case and method."""
    peers = ", ".join(f"{name} {number}" for name, number in result["peers"].items()) or "no peer installed"
    lines = [
        f"# Sparse regression on blind cases, {result['date']}",
        "",
        f"mccd {result['version']} (commit {result['commit']}), diagnoses by {result['diagnosed_by']}; {peers}.",
        "Made by:",
        "",
        "```",
        *result["commands"],
        "```",
        "",
        "Errors are of the held-out samples, over the error of the true structure with the true parameters. FROLS has "
        "names for no cause; SINDy's are those that its terms stand for, `?` where a term stands for none.",
        "",
        "| case | hidden (× naming limit) | method | error ÷ truth's | terms | says | processor time, s |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in result["cases"]:
        hidden = ", ".join(f"{h} ({t:.1f})" for h, t in zip(row["hidden"], row["times_naming"], strict=True))
        start = f"| {row['case']} | {hidden or 'nothing'} |"
        for method, found in row["found"].items():
            lines.append(f"{start} {method} {_cells(found, row['floor'], ', '.join(found['causes']))}")
        if row["ours"] is not None:
            said = row["ours"]["verdict"] + (": " + ", ".join(row["ours"]["causes"]) if row["ours"]["causes"] else "")
            lines.append(f"{start} mccd diagnose {_cells(row['ours'], row['floor'], said)}")
    return "\n".join(lines) + "\n"


def _cells(found: dict[str, Any], floor: float, said: str) -> str:
    error = "ran away" if found["error"] is None else f"{found['error'] / floor:.2f}"
    return f"| {error} | {found.get('terms', len(found['causes']))} | {said or '–'} | {found['seconds']:.1f} |"


if __name__ == "__main__":
    sys.exit(main())
