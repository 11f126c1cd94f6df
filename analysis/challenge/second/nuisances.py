"""What the nominal model's numbers and the starts of runs can explain, tuned as far as their priors allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.challenge.second.campaign import Campaign
from analysis.challenge.second.integrate import Motion
from analysis.challenge.second.plant import NOMINAL_ERROR, Plant

Array = NDArray[np.float64]

PRIOR = NOMINAL_ERROR / 3.0**0.5
"""Standard deviation of a number of the nominal model, relative."""

_STEP = 1e-4
_TUNINGS, _STILL = 4, 0.05
"""Gauss–Newton steps at most, and the change (in priors) that needs no further one."""

Number = tuple[str, int, int]
"""A number of the plant: which array, the mode, and the axis (0 where there is none)."""


def numbers_of(plant: Plant) -> list[Number]:
    """Return every number that a nominal model states and that is not zero."""
    found: list[Number] = []
    for m in range(plant.known):
        found += [("drive", m, int(a)) for a in np.flatnonzero(plant.drive[m])]
        found += [("shape", m, int(a)) for a in np.flatnonzero(plant.shape[:, m])]
        found += [(name, m, 0) for name in ("omega", "decay") if getattr(plant, name)[m] != 0.0]
    return found


def tuned(plant: Plant, numbers: Sequence[Number], steps: Array) -> Plant:
    """Return the plant whose `numbers` are off by `steps` (q,) standard deviations of their priors."""
    arrays = {name: getattr(plant, name).copy() for name in ("drive", "shape", "omega", "decay")}
    for (name, m, a), step in zip(numbers, steps, strict=True):
        at = {"drive": (m, a), "shape": (a, m)}.get(name, (m,))
        arrays[name][at] *= max(1.0 + PRIOR * step, 0.1)
    return replace(plant, **arrays)


def whitened(campaign: Campaign, parts: Sequence[Array]) -> Array:
    """Return the fitted samples of every run, (n, axes) or columns (n, axes, k), in units of the noise."""
    rows = []
    for record, part in zip(campaign.records, parts, strict=True):
        level = 1.0 + campaign.louder * record.levels()
        for axis, noise in enumerate(campaign.noises):
            column = part[:, axis]
            scaled = column / level.reshape(-1, *[1] * (column.ndim - 1))
            rows.append(noise.whiten(scaled)[record.mask()])
    return np.concatenate(rows)


@dataclass(frozen=True)
class Projection:
    """Columns (rows, q) of all nuisances about one plant, in standard deviations of their priors."""

    columns: Array
    factor: tuple[Array, bool]

    @classmethod
    def about(cls, campaign: Campaign, plant: Plant, motions: Sequence[Motion]) -> Projection:
        """Return the nuisances about `plant` along the commands of `motions`."""
        parts = []
        for index, (record, motion) in enumerate(zip(campaign.records, motions, strict=True)):
            columns = _model_columns(campaign, plant, motion.command)
            starts = _start_columns(campaign, plant, record.n, float(np.sqrt(np.mean(motion.y**2))))
            empty = np.zeros_like(starts)
            others = [starts if i == index else empty for i in range(len(campaign.records))]
            parts.append(np.concatenate([columns, *others], axis=2))
        columns = whitened(campaign, parts)
        gram = columns.T @ columns + np.eye(columns.shape[1])
        return cls(columns, scipy.linalg.cho_factor(gram))

    def fit(self, vectors: Array) -> Array:
        """Return the nuisances that explain vectors (rows, k) best, (q, k)."""
        return np.asarray(scipy.linalg.cho_solve(self.factor, self.columns.T @ vectors))

    def beyond(self, vectors: Array) -> Array:
        """Return the residual of vectors (rows, k) after nuisances, their prior penalty below: (rows + q, k)."""
        found = self.fit(vectors)
        return np.vstack([vectors - self.columns @ found, -found])


@dataclass(frozen=True)
class Left:
    """The residual of a signature after nuisances, (rows + q,), and the projection about their adjusted values."""

    vector: Array
    projection: Projection


def tune(campaign: Campaign, first: Projection, motions: Sequence[Motion], signature: Sequence[Array]) -> Left:
    """Return what tuned nuisances leave of a signature, (n, axes) for every run, about the commands of `motions`."""
    numbers = numbers_of(campaign.plant)
    whole = whitened(campaign, signature)
    projection, shift, at = first, np.zeros_like(whole), np.zeros(len(numbers))
    if campaign.control is not None:
        projection = Projection.about(campaign, campaign.plant, motions)
    for _ in range(_TUNINGS):
        target = whole - shift + projection.columns[:, : at.size] @ at
        found = projection.fit(target[:, None])[:, 0]
        moved = np.clip(found[: at.size] - at, -3.0, 3.0)
        if float(np.max(np.abs(moved))) < _STILL:
            break
        at = at + moved
        plant = tuned(campaign.plant, numbers, at)
        projection = Projection.about(campaign, plant, motions)
        shift = whitened(campaign, [campaign.answer(x.command, plant) - campaign.answer(x.command) for x in motions])
    target = whole - shift + projection.columns[:, : at.size] @ at
    return Left(projection.beyond(target[:, None])[:, 0], projection)


def _model_columns(campaign: Campaign, plant: Plant, command: Array) -> Array:
    """Return what 1 prior of each number of the nominal model changes in the readings, (n, axes, k)."""
    here, columns = campaign.linear(command, plant), []
    for name, m, a in numbers_of(plant):
        each = here[:, m] * plant.drive[m]
        if name == "drive":
            columns.append(each[:, a, None] * plant.shape[:, m])
        elif name == "shape":
            at = np.where(np.arange(plant.axes) == a, plant.shape[a, m], 0.0)
            columns.append(each.sum(axis=1)[:, None] * at)
        else:
            up, down = (campaign.linear(command, _only(plant, m, name, 1.0 + s * _STEP))[:, 0] for s in (1.0, -1.0))
            slope = ((up - down) * plant.drive[m]).sum(axis=1) / (2.0 * _STEP)
            columns.append(slope[:, None] * plant.shape[:, m])
    return PRIOR * np.stack(columns, axis=2)


def _only(plant: Plant, m: int, name: str, factor: float) -> Plant:
    """Return a plant of one mode alone, one of its numbers changed by a factor."""
    one = replace(plant, omega=plant.omega[m : m + 1], decay=plant.decay[m : m + 1])
    return replace(one, **{name: getattr(one, name) * factor})


def _start_columns(campaign: Campaign, plant: Plant, n: int, reach: float) -> Array:
    """Return the free motion of every known mode from a position and from a rate, (n, axes, 2 modes)."""
    columns, time = [], np.arange(n) / campaign.rate_hz
    for m in range(plant.known):
        root = np.sqrt(complex(plant.decay[m] ** 2 - plant.omega[m] ** 2))
        fast, slow = np.exp((root - plant.decay[m]) * time), np.exp((-root - plant.decay[m]) * time)
        for shape in (fast + slow, (fast - slow) / (root if abs(root) > 1e-9 else 1.0)):
            real = np.real(shape)
            columns.append(reach * (real / max(np.max(np.abs(real)), 1e-300))[:, None] * plant.shape[:, m])
    return np.stack(columns, axis=2)
