"""A rational fit of the response of θx: eighth order, 600 lines, with noise of a ten-thousandth of the rms response."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
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
SEEDS = 20
"""Noises over which errors are compared: with one of them, the luckier fit would win."""
PARAMETERS = 4 * BLOCKS + 1
"""Of four second-order blocks and a constant, as ours and vector fitting determine them."""

Fit = Callable[["Measured"], ComplexArray]
"""A way to fit: what is measured → the fitted response at the same lines."""


@dataclass(frozen=True)
class Measured:
    """Frequencies (Hz), the exact response, what is measured of it, and the noise's standard deviation."""

    frequency_hz: Array
    exact: ComplexArray
    values: ComplexArray
    std: float

    def error(self, response: ComplexArray) -> float:
        """Return the rms difference from the exact response, in standard deviations of the noise at one line."""
        return float(np.sqrt(np.mean(np.abs(response - self.exact) ** 2)) / self.std)


@cache
def data(seed: int = 0) -> Measured:
    """Return a measurement with the noise of this seed.

    The noise is white, of equal size at all lines, so that the plain least squares of vector fitting is the best that
    anybody can do.
    """
    frequency_hz = np.geomspace(1.0, 3000.0, LINES)
    exact = one_axis()[0].frequency_response(frequency_hz)[:, 0, 0]
    std = NOISE * float(np.sqrt(np.mean(np.abs(exact) ** 2)))
    rng = np.random.default_rng(seed)
    noise = (rng.standard_normal(LINES) + 1j * rng.standard_normal(LINES)) / np.sqrt(2.0)
    return Measured(frequency_hz, exact, exact + std * noise, std)


def ours(of: Measured) -> ComplexArray:
    """Return our model's response; the fit is told the noise."""
    fit = fit_rational(of.frequency_hz, of.values[:, None, None], BLOCKS, variance=np.full((LINES, 1, 1), of.std**2))
    return fit.model.frequency_response(of.frequency_hz)[:, 0, 0]


def vector_fitting() -> Fit:
    """Return scikit-rf's way to fit, imported; its first poles are spread over the decades as ours are."""
    from skrf import Frequency, Network
    from skrf.vectorFitting import VectorFitting

    def run(of: Measured) -> ComplexArray:
        network = Network(frequency=Frequency.from_f(of.frequency_hz, unit="hz"), s=of.values[:, None, None], z0=50)
        fit = VectorFitting(network)
        fit.vector_fit(n_poles_real=0, n_poles_cmplx=BLOCKS, init_pole_spacing="log", fit_constant=True)
        return np.asarray(fit.get_model_response(0, 0, of.frequency_hz))

    return run


def adaptive(of: Measured) -> ComplexArray:
    """Return the response of AAA's rational function of the same order."""
    point = 2j * np.pi * of.frequency_hz
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # it does not meet its tolerance: there is noise
        return np.asarray(AAA(point, of.values, max_terms=2 * BLOCKS + 1, clean_up=False)(point))


@cache
def errors(name: str) -> Array:
    """Return the errors of a contender at `SEEDS` noises, in standard deviations of the noise at one line."""
    fit: Fit = vector_fitting() if name == VECTOR else {OURS: ours, ADAPTIVE: adaptive}[name]
    return np.array([data(seed).error(fit(data(seed))) for seed in range(SEEDS)])


def rms(values: Array) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def check(results: Mapping[str, Any]) -> list[Agreement]:
    """Compare every fit with the exact response, by the rms of its error over all noises.

    17 parameters fitted to 1200 real numbers leave sqrt(17 / 1200) of the noise. The square over 20 noises follows a
    chi-square of 340 degrees of freedom, which is beyond 1.25 times its mean once in a thousand times.
    """
    left = float(np.sqrt(1.25 * PARAMETERS / (2.0 * LINES)))
    noise = "in standard deviations of the noise, rms of 20: what a fit of 17 parameters leaves of it"
    lost = "in standard deviations of the noise, rms of 20: it interpolates noisy values and loses the weak modes"
    allowed = {OURS: (left, noise), VECTOR: (left, noise), ADAPTIVE: (100.0, lost)}
    return [Agreement(name, rms(errors(name)), *allowed[name]) for name in results]


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return the fits that are there, all imported; `quick` is the same, it takes milliseconds."""
    absent = missing("skrf", "scikit-rf")
    fits: dict[str, Fit] = {OURS: ours, ADAPTIVE: adaptive}
    if absent is None:
        fits[VECTOR] = vector_fitting()
    facts: dict[str, Any] = {"lines": LINES, "order": 2 * BLOCKS, "noise ÷ rms response": NOISE, "noises": SEEDS}
    for name in fits:
        some = errors(name)
        facts[f"error of {name}"] = f"{np.median(some):.3g} ({some.min():.3g} to {some.max():.3g})"
    contenders = tuple(Contender(name, partial(fit, data())) for name, fit in fits.items())
    return Prepared(contenders, check, {} if absent is None else {VECTOR: absent}, facts)


def no_worse_than(peer: str) -> Target:
    """Return the target that our error is at most that of `peer`, rms over all noises."""

    def ratio(turn: Round) -> float:
        return rms(errors(OURS)) / rms(errors(peer))

    return Target(f"{OURS}: error over 20 noises ÷ that of {peer}", 1.0, "×", (OURS, peer), ratio, at_most=True)


BENCHMARK = Benchmark(
    name="rational-fit",
    work="eighth-order fit of θx's response at 600 lines with white noise",
    prepare=prepare,
    one_core=True,
    targets=(
        times_the_time(OURS, VECTOR, 2.0),
        no_worse_than(VECTOR),
        times_the_time(OURS, ADAPTIVE, 1.0),
        no_worse_than(ADAPTIVE),
    ),
    missed={},
)
