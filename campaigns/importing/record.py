"""From selected arrays to one record: axes put in time order, clock found, values checked and converted to SI."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.importing.mapping import Axis, ChannelMap
from campaigns.log.units import Unit
from sim_backend.errors import DataError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Layout:
    """How the rows of one part came from its arrays: `realisations` x `periods` x `samples` each."""

    samples: int
    realisations: int
    periods: int

    @property
    def rows(self) -> int:
        """Rows of the part."""
        return self.samples * self.realisations * self.periods


def flatten(values: NDArray[np.generic], axes: Sequence[Axis], what: str) -> tuple[Array, Layout]:
    """Put an array with the named axes into time order: samples within periods within realisations.

    Returns the rows as (n,) and their layout. Axes of length 1 may be left out of `axes`. Raises DataError when the
    axes do not fit or the values are no real numbers.
    """
    if values.dtype.kind not in "fiub":
        raise DataError(f"{what} holds values of type {values.dtype}: select real numbers")
    if values.ndim != len(axes):
        values = values.squeeze()
    if values.ndim != len(axes):
        raise DataError(
            f"{what} has shape {values.shape}, but axes = {list(axes)} names {len(axes)}: select one column, "
            "as in 'u[:, 0]', or name all axes"
        )
    length = dict(zip(axes, values.shape, strict=True))
    order = [axes.index(axis) for axis in ("realisation", "period", "sample") if axis in axes]
    layout = Layout(length["sample"], length.get("realisation", 1), length.get("period", 1))
    if not layout.rows:
        raise DataError(f"{what} is empty (shape {values.shape}): select a variable that holds samples")
    return np.ascontiguousarray(values.transpose(order), dtype=np.float64).reshape(-1), layout


def to_si(values: Array, channel: ChannelMap, unit: Unit, what: str) -> Array:
    """Return `values` (n,) times the channel's scale, in SI; raises DataError naming the first that is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        si = values * (channel.scale * unit.factor) + unit.offset
    bad = np.flatnonzero(~np.isfinite(si))
    if bad.size:
        raise DataError(
            f"{what} holds {values[bad[0]]} at sample {bad[0]} and {bad.size} value(s) in all that are not finite: "
            "repair them or import the stretches between them"
        )
    return si


def unwrapped(values: Array, jump: float) -> Array:
    """Return readings (n,) of a counter or an angle that begins anew after `jump`, without those jumps.

    Two readings must lie less than half a `jump` apart.
    """
    return np.unwrap(values, period=jump)


def check_lengths(layouts: Mapping[str, Layout], where: str) -> Layout:
    """Return the layout that all channels share; raises DataError naming two that differ."""
    (first, layout), *others = layouts.items()
    for name, other in others:
        if other != layout:
            raise DataError(
                f"{where}channel '{first}' has {layout.rows} samples and '{name}' has {other.rows} "
                f"({layout} against {other}): select equal lengths"
            )
    return layout


def check_varies(parts: Sequence[Array], name: str, channel: ChannelMap) -> None:
    """Raise DataError when an input or output, in parts (n,), has one value throughout and the map forbids that."""
    low, high = min(float(part.min()) for part in parts), max(float(part.max()) for part in parts)
    if low == high and channel.role in ("input", "output") and not channel.allow_constant:
        raise DataError(
            f"channel '{name}' is constant at {low:g} (SI) in all samples: select another variable, "
            f"or set allow_constant = true in [channels.{name}]"
        )
