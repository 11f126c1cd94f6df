"""A linear simulation of 600,000 samples: one axis of the bench's design model, eighth order, a held random torque."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from analysis.linear.simulate import simulate_linear
from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared, times_faster, version_of
from sim_backend.linear import ModalModel, discretise
from sim_backend.model import load_model

Array = NDArray[np.float64]

OURS, LFILTER, RESPONSE = "mccd simulate_linear", "scipy lfilter", "control forced_response"
SAMPLES, QUICK = 600_000, 6_000
SPARED = 10
"""Part of the samples that python-control is given: its time per sample does not depend on how many there are."""


def one_axis() -> tuple[ModalModel, float]:
    """Return the four modes of θx of the model `design`, and its sample rate in Hz."""
    model = load_model("design")
    whole = model.linear()
    modes = np.flatnonzero(whole.b[:, 0])
    return ModalModel(
        whole.omega_rad_s[modes],
        whole.sigma_1_s[modes],
        whole.b[modes, :1],
        whole.b_direct[modes, :1],
        whole.c[:1, modes],
        whole.c_rate[:1, modes],
        whole.d[:1, :1],
        whole.delay_s[:1],
    ), model.sample_rate_hz


def continuous(model: ModalModel) -> control.StateSpace:
    """Return the model, of one input and one output, as one continuous state space."""
    m = model.n_blocks
    a, b, c = np.zeros((2 * m, 2 * m)), np.zeros((2 * m, 1)), np.zeros((1, 2 * m))
    for i in range(m):
        at = slice(2 * i, 2 * i + 2)
        a[at, at] = [[0.0, 1.0], [-(model.omega_rad_s[i] ** 2), -2.0 * model.sigma_1_s[i]]]
        b[at, 0] = model.b_direct[i, 0], model.b[i, 0]
        c[0, at] = model.c[0, i], model.c_rate[0, i]
    return control.StateSpace(a, b, c, model.d)


def polynomials(sampled: control.StateSpace) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return numerator and denominator in powers of 1/z, from the products of the factors.

    Zeros are the eigenvalues of A - B C / d of the system one sample ahead, whose feedthrough C B is not zero.
    """
    poles = np.linalg.eigvals(sampled.A)
    gain = (sampled.C @ sampled.B)[0, 0]
    zeros = np.linalg.eigvals(sampled.A - sampled.B @ (sampled.C @ sampled.A) / gain)
    zeros = zeros[np.argsort(np.abs(zeros))[1:]]  # one sample ahead adds a zero at the origin
    return np.concatenate([[0.0], gain * np.poly(zeros).real]), np.poly(poles).real


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return the three contenders; python-control samples the continuous model itself."""
    model, rate_hz = one_axis()
    n = QUICK if quick else SAMPLES
    torque = 1e-3 * np.random.default_rng(0).standard_normal(n)
    exact = discretise(model, rate_hz)
    sampled = control.sample_system(continuous(model), 1.0 / rate_hz, "zoh")
    numerator, denominator = polynomials(sampled)
    part = torque[: n // SPARED]
    return Prepared(
        (
            Contender(OURS, lambda: simulate_linear(exact, torque[:, None])[:, 0], n),
            Contender(LFILTER, lambda: lfilter(numerator, denominator, torque), n),
            Contender(RESPONSE, lambda: control.forced_response(sampled, U=part).outputs, part.size),
        ),
        check,
        {},
        {"samples": n, "order": exact.a.shape[0] * 2, "control": version_of("control")},
    )


def check(results: Mapping[str, Any]) -> list[Agreement]:
    """Compare with python-control, whose state space of all modes is the most independent of ours."""
    n = results[RESPONSE].size
    size = np.max(np.abs(results[RESPONSE]))

    def error(name: str) -> float:
        return float(np.max(np.abs(results[name][:n] - results[RESPONSE])) / size)

    return [
        # a rounding of 1e-16 at every sample lives on for the memory of the slowest mode, 1/5 s or 2000 samples, and
        # the lowest mode's rounding is amplified by its static gain, 1/(1 - |z|) or thereabouts
        Agreement(OURS, error(OURS), 1e-10, "rounding of another order of summation"),
        # the eighth-order polynomial has its poles within 0.02 of z = 1, so that its coefficients' rounding
        # moves them: that is lfilter's form, not its fault
        Agreement(LFILTER, error(LFILTER), 1e-3, "the polynomial's coefficients are ill-conditioned"),
    ]


BENCHMARK = Benchmark(
    name="linear-simulation",
    work="response of θx, eighth order, to 600,000 samples of a held random torque",
    prepare=prepare,
    one_core=True,
    targets=(times_faster(OURS, LFILTER, 1.0), times_faster(OURS, RESPONSE, 100.0)),
    missed={},
)
