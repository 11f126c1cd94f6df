"""A rational fit of the response of θx: eighth order, 600 lines, with noise of a ten-thousandth of the rms response."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import AAA

from analysis.identification.rational import fit_rational
from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared, Round, Target, missing, times_the_time
from benchmarks.speed.linear_simulation import one_axis

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

OURS, VECTOR, ADAPTIVE = "mccd fit_rational", "scikit-rf VectorFitting", "scipy AAA"
LINES, NOISE, BLOCKS = 600, 1e-4, 4
PARAMETERS = 4 * BLOCKS + 1
"""Of four second-order blocks and a constant, as ours and vector fitting determine them."""


@cache
def data() -> tuple[Array, ComplexArray, ComplexArray, float]:
    """Return frequencies (Hz), the exact response, what is measured of it, and the noise's standard deviation.

    The noise is white, of equal size at all lines, so that the plain least squares of vector fitting is the best that
    anybody can do.
    """
    frequency_hz = np.geomspace(1.0, 3000.0, LINES)
    exact = one_axis()[0].frequency_response(frequency_hz)[:, 0, 0]
    std = NOISE * float(np.sqrt(np.mean(np.abs(exact) ** 2)))
    rng = np.random.default_rng(0)
    noise = (rng.standard_normal(LINES) + 1j * rng.standard_normal(LINES)) / np.sqrt(2.0)
    return frequency_hz, exact, exact + std * noise, std


def ours() -> ComplexArray:
    """Return our model's response; the fit is told the noise."""
    frequency_hz, _, measured, std = data()
    variance = np.full((LINES, 1, 1), std**2)
    return fit_rational(frequency_hz, measured[:, None, None], BLOCKS, variance=variance).model.frequency_response(
        frequency_hz
    )[:, 0, 0]


def vector_fitting() -> ComplexArray:
    """Return the response of scikit-rf's model, its first poles spread over the decades as ours are."""
    from skrf import Frequency, Network
    from skrf.vectorFitting import VectorFitting

    frequency_hz, _, measured, _ = data()
    network = Network(frequency=Frequency.from_f(frequency_hz, unit="hz"), s=measured[:, None, None], z0=50)
    fit = VectorFitting(network)
    fit.vector_fit(n_poles_real=0, n_poles_cmplx=BLOCKS, init_pole_spacing="log", fit_constant=True)
    return np.asarray(fit.get_model_response(0, 0, frequency_hz))


def adaptive() -> ComplexArray:
    """Return the response of AAA's rational function of the same order."""
    frequency_hz, _, measured, _ = data()
    point = 2j * np.pi * frequency_hz
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # it does not meet its tolerance: there is noise
        return np.asarray(AAA(point, measured, max_terms=2 * BLOCKS + 1, clean_up=False)(point))


def error(response: ComplexArray) -> float:
    """Return the rms difference from the exact response, in standard deviations of the noise at one line."""
    _, exact, _, std = data()
    return float(np.sqrt(np.mean(np.abs(response - exact) ** 2)) / std)


def check(results: Mapping[str, Any]) -> list[Agreement]:
    """Compare every fit with the exact response.

    17 parameters fitted to 1200 real numbers leave sqrt(17 / 1200) of the noise; half as much again is rare: the square
    follows a chi-square of 17 degrees of freedom, which is beyond 2.25 times its mean in 0.3 % of all cases.
    """
    left = 1.5 * float(np.sqrt(PARAMETERS / (2.0 * LINES)))
    noise = "in standard deviations of the noise: what a fit of 17 parameters leaves of it"
    lost = "in standard deviations of the noise: it interpolates noisy values and loses the weak modes"
    allowed = {OURS: (left, noise), VECTOR: (left, noise), ADAPTIVE: (100.0, lost)}
    return [Agreement(name, error(result), *allowed[name]) for name, result in results.items()]


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return the fits that are there; `quick` is the same, it takes milliseconds."""
    absent = missing("skrf", "scikit-rf")
    contenders = [Contender(OURS, ours), Contender(ADAPTIVE, adaptive)]
    if absent is None:
        contenders.append(Contender(VECTOR, vector_fitting))
    facts = {"lines": LINES, "order": 2 * BLOCKS, "noise ÷ rms response": NOISE}
    return Prepared(tuple(contenders), check, {} if absent is None else {VECTOR: absent}, facts)


def no_worse_than(peer: str) -> Target:
    """Return the target that our error is at most that of `peer`."""

    def ratio(turn: Round) -> float:
        return error(turn.results[OURS]) / error(turn.results[peer])

    return Target(f"{OURS}: error ÷ that of {peer}", 1.0, "×", (OURS, peer), ratio, at_most=True)


BENCHMARK = Benchmark(
    name="rational-fit",
    work="eighth-order fit of θx's response at 600 lines with white noise",
    prepare=prepare,
    one_core=True,
    targets=(
        times_the_time(OURS, VECTOR, 2.0),
        no_worse_than(VECTOR),
        times_the_time(OURS, ADAPTIVE, 2.0),
        no_worse_than(ADAPTIVE),
    ),
    missed={
        times_the_time(OURS, ADAPTIVE, 2.0).what: (
            "AAA interpolates nine of the noisy values and finds only the weights between them, without an iteration: "
            "it is fast because it solves another problem. Its error is that of a fit that has lost the weak modes, "
            "and its function has complex coefficients, no model in time. Ours moves poles seven times, 0.26 ms each, "
            "of which the decomposition of 1200 equations takes 0.07 ms, and then minimises the weighted error in "
            "three steps of 0.5 ms with its Jacobian; the one alone takes as long as AAA, and so does the other."
        )
    },
)
