"""Inner products of signatures, whitened by the true noise, less what wrong nominal parameters and starts explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.challenge.campaign import Campaign
from analysis.challenge.families import Hidden
from analysis.challenge.plant import NOMINAL_ERROR, Plant

Array = NDArray[np.float64]

PRIOR_SD = NOMINAL_ERROR / np.sqrt(3.0)
"""Standard deviation of each nominal parameter's relative error, uniform within ±3 %."""

_COARSE = 2
"""Fine steps per sample here: the signature of an effect needs less accuracy than the data that hold it."""


_STEP = 1e-5
"""Step of differences, in standard deviations: its error is of that order times the resonance's quality."""


@dataclass(frozen=True)
class Seen:
    """Signatures as a metric sees them: `vectors` (tuned + rows, k), and `explained` (nuisances, k).

    The inner product of two, nuisances projected out, is that of the vectors less that of the explained parts.
    """

    vectors: Array
    explained: Array

    def products(self, other: Seen | None = None) -> Array:
        """Return the inner products (k, l) with `other`, by default with themselves."""
        other = self if other is None else other
        return np.asarray(self.vectors.T @ other.vectors - self.explained.T @ other.explained)


@dataclass(frozen=True)
class Metric:
    """Inner products of whitened signatures over all samples that may be fitted, nuisances projected out.

    The nuisances are linearised about the plant adjusted by `tuned` (nuisance parameters in prior standard deviations).
    `readings` are those without effects there, `blocks` per run and axis the whitened nuisances (rows, k), the starts
    after the parameters; `factor` is the lower Cholesky factor of prior + N'N.
    """

    campaign: Campaign
    noise: list[Array]
    tuned: Array
    readings: list[Array]
    blocks: list[Array]
    factor: Array

    @classmethod
    def of(cls, campaign: Campaign, tuned: Array | None = None, beside: Sequence[Hidden] = ()) -> Metric:
        """Return the metric of a campaign about its plant, or one adjusted by `tuned` (n,), with effects in it."""
        coarse = campaign.coarse(_COARSE)
        noise = campaign.noise()
        tuned = np.zeros(len(places_of(campaign.plant))) if tuned is None else tuned
        plant = adjusted(campaign.plant, tuned)
        known = [effect for effect in beside if effect.predictable]
        readings = replace(coarse, plant=plant).readings(known, noise)
        for effect in known:
            plant = effect.on_plant(plant)
        slopes = [_slope(coarse, known, noise, readings, tuned, i) for i in range(tuned.size)]
        n_starts = 2 * plant.n_modes * len(campaign.runs)
        blocks = []
        for r, run in enumerate(campaign.runs):
            rows = run.rows(held_out=False)
            free = _free_responses(plant, run.excitation.n, run.excitation.rate_hz)
            for a, colour in enumerate(campaign.noises):
                starts = np.zeros((run.excitation.n, n_starts))
                width = free.shape[2]
                starts[:, r * width : (r + 1) * width] = free[:, a]
                columns = np.column_stack([*(k[r][:, a] for k in slopes), starts])
                blocks.append(colour.whiten(columns)[rows])
        products = sum((b.T @ b for b in blocks), np.zeros((tuned.size + n_starts,) * 2))
        # nuisance parameters are scaled to unit prior; a start is known no better than to a thousand times what the
        # noise leaves of it
        prior = np.concatenate([np.ones(tuned.size), 1e-6 * np.maximum(np.diag(products)[tuned.size :], 1e-300)])
        return cls(coarse, noise, tuned, readings, blocks, scipy.linalg.cholesky(products + np.diag(prior), lower=True))

    def signature(self, hidden: Sequence[Hidden]) -> Array:
        """Return the whitened change of all fitted readings by `hidden`, one long vector (rows + tuned,).

        After the readings follow the nuisance parameters at which the metric is taken, which their prior penalises.
        """
        return self._whitened(self.campaign.readings(hidden, self.noise), -self.tuned)

    def change(self, hidden: Sequence[Hidden]) -> Array:
        """Return the whitened change of all fitted readings by `hidden` on the plant as adjusted, (tuned + rows,).

        The nuisance parameters are not changed.
        """
        there = replace(self.campaign, plant=adjusted(self.campaign.plant, self.tuned)).readings(hidden, self.noise)
        return self._whitened(there, np.zeros(self.tuned.size))

    def seen(self, vectors: Array) -> Seen:
        """Return signatures (tuned + rows, k) with the part of them that the nuisances explain."""
        return Seen(vectors, scipy.linalg.solve_triangular(self.factor, self._onto(vectors), lower=True))

    def step(self, vector: Array) -> Array:
        """Return the change of the nuisance parameters that explains most of one signature, shape (tuned,)."""
        return np.asarray(
            scipy.linalg.cho_solve((self.factor, True), self._onto(vector[:, None]))[: self.tuned.size, 0]
        )

    def _whitened(self, readings: Sequence[Array], tuned: Array) -> Array:
        parts = [tuned]
        for run, values, before in zip(self.campaign.runs, readings, self.readings, strict=True):
            rows, change = run.rows(held_out=False), values - before
            parts += [colour.whiten(change[:, [a]])[rows, 0] for a, colour in enumerate(self.campaign.noises)]
        return np.concatenate(parts)

    def _onto(self, vectors: Array) -> Array:
        onto, at = np.zeros((self.blocks[0].shape[1], vectors.shape[1])), self.tuned.size
        onto[:at] = vectors[:at]
        for block in self.blocks:
            onto += block.T @ vectors[at : at + block.shape[0]]
            at += block.shape[0]
        return onto


def places_of(plant: Plant) -> list[tuple[str, tuple[int, ...]]]:
    """Return which numbers of a plant the nominal model states: field and index."""
    names = ("omega_rad_s", "sigma_1_s", "b", "c")
    return [(name, tuple(int(i) for i in at)) for name in names for at in np.argwhere(getattr(plant, name) != 0.0)]


def adjusted(plant: Plant, tuned: Array) -> Plant:
    """Return the plant with each stated number changed by `tuned` (n,) prior standard deviations, see `places_of`."""
    values = {name: getattr(plant, name).copy() for name in ("omega_rad_s", "sigma_1_s", "b", "c")}
    for (name, at), value in zip(places_of(plant), tuned, strict=True):
        values[name][at] *= np.exp(PRIOR_SD * value)
    return plant.with_(**values)


def _slope(
    campaign: Campaign, known: Sequence[Hidden], noise: list[Array], readings: list[Array], tuned: Array, i: int
) -> list[Array]:
    """Return the change of all readings per standard deviation of one parameter, by a small forward difference."""
    there = tuned.copy()
    there[i] += _STEP
    moved = replace(campaign, plant=adjusted(campaign.plant, there)).readings(known, noise)
    return [(y - b) / _STEP for y, b in zip(moved, readings, strict=True)]


def _free_responses(plant: Plant, n: int, rate_hz: float) -> Array:
    """Return what each axis reads of each mode's ring-down, shape (n, axes, 2 modes): its sine and its cosine."""
    time_s = np.arange(n)[:, None] / rate_hz
    damped = np.sqrt(np.maximum(plant.omega_rad_s**2 - plant.sigma_1_s**2, 0.0))
    decay = np.exp(-plant.sigma_1_s * time_s)
    ring = np.stack([decay * np.cos(damped * time_s), decay * np.sin(damped * time_s)], axis=2)
    return np.asarray((plant.c[None, :, :, None] * ring[:, None]).reshape(n, plant.n_axes, -1))
