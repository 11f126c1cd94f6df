"""Which axis a mode belongs to: the readings that it moves most, whatever units they are in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.identification.determined import residues_of
from sim_backend.linear import Array, ModalModel

MOSTLY = 0.5
"""Part of a mode's largest movement from which on it belongs to another reading as well."""


def axes_of_modes(model: ModalModel, dofs: Sequence[str]) -> tuple[str, ...]:
    """Return the axes of every block of a model, given the degree of freedom of each output (n_y)."""
    size = _without_units(np.abs(residues_of(model))).max(axis=2, initial=0.0)
    named = []
    for moved in size:
        most = float(moved.max(initial=0.0))
        own = [dof for dof, part in zip(dofs, moved.tolist(), strict=True) if part > 0.0 and part >= MOSTLY * most]
        named.append(", ".join(dict.fromkeys(own)))
    return tuple(named)


def _without_units(size: Array) -> Array:
    """Return sizes (m, n_y, n_u) over one scale for each output and each input, by their geometric means.

    What couples axes is small in every row and column alike, so that the scales are those of the units.
    """
    largest = size.max(axis=0, initial=0.0)
    logs = np.log(np.where(largest > 0.0, largest, np.nan))
    known = np.isfinite(logs)
    if not known.any():
        return size
    rows = np.array([np.mean(row[k]) if k.any() else 0.0 for row, k in zip(logs, known, strict=True)])
    rest = logs - rows[:, None]
    columns = np.array([np.mean(rest[k, j]) if k.any() else 0.0 for j, k in enumerate(known.T)])
    return np.asarray(size / np.exp(rows[:, None] + columns))
