"""What a model leaves of a response: by frequency against the noise, and on the lines that no fit has seen."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.response.lines import EVERY, Lines
from analysis.diagnosis.response.noise import Noise
from analysis.diagnosis.result import Domain, Gain
from analysis.pages.quantities import span
from sim_backend.model import Model

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

BANDS = 40
DRAWS = 2000


def by_frequency(lines: Lines, noise: Noise, modelled: ComplexArray, model: Model, record: str) -> tuple[Domain, ...]:
    """Return, per curve, what a model's response (n,) leaves in bands of neighbouring lines, in noises."""
    turned = (lines.response - modelled) * np.exp(-1j * np.angle(lines.response))
    square = 0.5 * ((turned.real / noise.sigma[:, 0]) ** 2 + (turned.imag / noise.sigma[:, 1]) ** 2)
    found = []
    for number in np.unique(lines.curve):
        rows = np.flatnonzero(lines.curve == number)
        parts = np.array_split(rows, min(BANDS, rows.size))
        level = np.sqrt([square[part].mean() for part in parts])
        axis = np.array([np.exp(np.log(lines.frequency_hz[part]).mean()) for part in parts])
        total, dof = float(square[rows].mean()), 2 * rows.size
        p = scipy.stats.chi2.sf(total * dof, dof) if np.isinf(noise.dof) else scipy.stats.f.sf(total, dof, noise.dof)
        worst = parts[int(np.argmax(level))]
        place = span(lines.frequency_hz[worst[0]], lines.frequency_hz[worst[-1]], "Hz")
        name = model.outputs[int(lines.output[rows[0]])].dof
        at = "" if np.isnan(lines.level[rows[0]]) else f" at level {lines.level[rows[0]]:g}"
        where = f"{name} at {place}{at}: {level.max():.3g} times the noise"
        found.append(Domain(record, name, axis, "Hz", level, np.ones(level.size), float(p), where))
    return tuple(found)


def gain_of(
    lines: Lines, noise: Noise, before: ComplexArray, after: ComplexArray, record: str, seed: int
) -> Gain | None:
    """Return what the extension gains on held-out lines: rms of their errors, each over its line; None without any.

    That is the error of the output over the output under an excitation that makes every line of it as strong. The
    interval is a bootstrap over blocks of neighbouring lines.
    """
    held = lines.held_out
    if not held.any():
        return None
    size2 = np.abs(lines.response[held]) ** 2
    errors = [np.abs(lines.response - modelled)[held] ** 2 / size2 for modelled in (before, after)]
    first, last = (float(np.sqrt(e.mean())) for e in errors)
    rows = np.flatnonzero(held)
    block = np.cumsum(np.diff(rows, prepend=rows[0]) > 1)
    sums = [np.bincount(block, e) for e in errors]
    drawn = np.random.default_rng(seed).integers(0, sums[0].size, (DRAWS, sums[0].size))
    ratio = np.sqrt(sums[1][drawn].sum(axis=1) / np.maximum(sums[0][drawn].sum(axis=1), np.finfo(float).tiny))
    low, high = np.quantile(1.0 - ratio, [0.025, 0.975])
    # noise that is known from other lines may seem larger than the error that it is part of
    floor = min(float(np.sqrt(np.mean(np.sum(noise.sigma[held] ** 2, axis=1) / size2))), first, last)
    return Gain(
        held_out=(f"{record}#one of {EVERY} blocks of neighbouring lines, {int(held.sum())} of {lines.n} lines",),
        rms_before=first,
        rms_after=last,
        noise_floor=floor,
        reduction=1.0 - last / first if first > 0.0 else 0.0,
        ci95=(float(low), float(high)),
    )
