"""The frequency response of a record of 10 million samples, 3 inputs and 3 outputs, with noise and distortion."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from analysis.frequency.frf import FrequencyResponse, frequency_response_periodic
from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared, times_the_time

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

OURS, BARE = "mccd frequency_response_periodic", "scipy bare FFTs"
AXES, REALISATIONS, PERIODS = 3, 6, 13
SAMPLES, QUICK = 131_072, 512
"""Samples of a period: 131,072 × 6 × 13 = 10.2 million."""
COMPARED = 64
"""Lines at which the response is computed again, one by one, from the bare spectra."""


def records(n: int) -> tuple[Array, Array]:
    """Return inputs and outputs (sample, channel, realisation, period), each channel contiguous in time.

    Orthogonal random-phase multisines through a matrix of first-order lags, with noise in every period.
    """
    rng = np.random.default_rng(0)
    bins = n // 2 + 1
    phase = np.exp(2j * np.pi * rng.random((AXES, REALISATIONS // AXES, bins)))
    phase[..., 0] = phase[..., -1] = 0.0
    turn = np.exp(2j * np.pi * np.outer(np.arange(AXES), np.arange(AXES)) / AXES)
    spectrum = (phase[:, :, None] * turn[:, None, :, None]).reshape(AXES, REALISATIONS, bins) * np.sqrt(n / 2.0)
    pole = 1.0 / (1.0 + 2j * np.pi * np.linspace(0.0, 1.0, bins))
    gain = rng.standard_normal((AXES, AXES))
    inputs = np.repeat(fft.irfft(spectrum, n)[:, :, None], PERIODS, axis=2)
    clean = fft.irfft(np.einsum("yu,urf->yrf", gain, spectrum) * pole, n)
    outputs = clean[:, :, None] + 0.01 * rng.standard_normal((AXES, REALISATIONS, PERIODS, n))
    return np.moveaxis(inputs, -1, 0), np.moveaxis(outputs, -1, 0)


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return ours and the transforms alone, both on one thread and on arrays that are contiguous in time."""
    inputs, outputs = records(QUICK if quick else SAMPLES)
    lines = np.arange(1, inputs.shape[0] // 2)

    def ours() -> FrequencyResponse:
        return frequency_response_periodic(inputs, outputs, 1.0, workers=1)

    def bare() -> tuple[ComplexArray, ComplexArray]:
        first, second = (fft.rfft(np.moveaxis(x, 0, -1), norm="forward") for x in (inputs, outputs))
        return first, second

    def check(results: Mapping[str, Any]) -> list[Agreement]:
        chosen = np.unique(np.linspace(0, lines.size - 1, COMPARED).astype(int))
        u, y = (s[..., lines[chosen]] for s in results[BARE])
        got: FrequencyResponse = results[OURS]
        errors = [0.0 if np.array_equal(got.frequency_hz * inputs.shape[0], lines) else np.inf]
        for name, reference in line_by_line(u, y).items():
            errors.append(float(np.max(np.abs(getattr(got, name)[chosen] - reference)) / np.max(np.abs(reference))))
        # sums over 78 records, whose differences are at worst 1e-5 of what they are the difference of
        return [Agreement(OURS, max(errors), 1e-9, "response and variances at 64 lines; rounding of differences")]

    return Prepared(
        (Contender(OURS, ours), Contender(BARE, bare)),
        check,
        {},
        {"samples": inputs.shape[0] * REALISATIONS * PERIODS, "inputs": AXES, "outputs": AXES, "threads": 1},
    )


def line_by_line(u: ComplexArray, y: ComplexArray) -> dict[str, Any]:
    """Return response, noise and total variance from spectra (channel, realisation, period, line), by plain formulas.

    R. Pintelon and J. Schoukens, System Identification (2012), section 4.3, with orthogonal blocks of experiments.
    """
    um, ym = u.mean(axis=2), y.mean(axis=2)
    found: dict[str, list[Any]] = {"response": [], "noise_variance": [], "total_variance": []}
    for k in range(u.shape[-1]):
        g = ym[..., k] @ np.linalg.pinv(um[..., k])
        error = (y - ym[:, :, None])[..., k] - np.einsum("yu,urp->yrp", g, (u - um[:, :, None])[..., k])
        noise = np.sum(np.abs(error) ** 2, axis=(1, 2)) / (REALISATIONS * (PERIODS - 1)) / PERIODS
        gain = np.diag(np.linalg.inv(um[..., k] @ um[..., k].conj().T)).real
        blocks = [
            ym[:, first : first + AXES, k] @ np.linalg.inv(um[:, first : first + AXES, k])
            for first in range(0, REALISATIONS, AXES)
        ]
        found["response"].append(g)
        found["noise_variance"].append(np.outer(noise, gain))
        found["total_variance"].append(sum(np.abs(b - g) ** 2 for b in blocks) / (len(blocks) * (len(blocks) - 1)))
    return {name: np.array(values) for name, values in found.items()}


BENCHMARK = Benchmark(
    name="frequency-response",
    work="response, 3 × 3, with noise and total variance from 10.2 million samples of each of 6 channels",
    prepare=prepare,
    one_core=True,
    targets=(times_the_time(OURS, BARE, 1.5),),
    missed={
        times_the_time(OURS, BARE, 1.5).what: (
            "What follows the transforms is one pass over their 0.5 GB, on vectors of neighbouring lines: it fetches "
            "the spectra, takes the response's share off every period's output (46 million complex products) for the "
            "noise, and solves all lines and all blocks of experiments. All of that has to fit into half the time of "
            "the transforms. Both ask the system for the same memory in each round, and wait for it by turns."
        )
    },
)
