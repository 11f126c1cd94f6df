"""What of a bench is compiled into its loop: sizes, which weights are zero or one, and where effects are connected.

Values are not: benches that differ in their numbers alone share a loop.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backend import layout

LANES = 4
"""Benches that one loop can play side by side: as many float64 as one instruction takes."""

ZERO, ONE, ANY = 0, 1, 2
"""What the structure of a bench says of a weight: it is 0 and left out, 1 and not multiplied, or any number."""

NO_DELAY = 0
"""Columns of a queue in which nothing waits."""

_WEIGHTS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("plant", ("a", "b", "push", "c", "d", "rate_d")),
    ("hw", ("to_current", "to_torque", "to_heads", "to_reading")),
    ("ctl", ("fa", "fb", "fc", "fd")),
    ("fx", ("coordinates", "levers")),
)
_WIRING = ("channel", "p0", "s0", "aux", "column", "watched", "moved")


@dataclass(frozen=True)
class Structure:
    """All that the emitted code depends on; equal structures have the same code.

    `shapes` are those of all weights, `kinds` says of every entry of them whether it is zero or one. `plant` says who
    drives and sees which mode, `sites` which batches are at a site. `wiring`, where each effect is connected, and
    `steps`, their compiled steps, are there only where effects are inlined: otherwise they are called by address.
    `lanes` benches are played side by side.
    """

    shapes: tuple[tuple[int, ...], ...]
    kinds: bytes
    plant: tuple[bytes, ...]
    sites: bytes
    wiring: bytes
    steps: tuple[Any, ...]
    learning: bytes
    n_columns: int
    n_rates: int
    n_parameters: int
    n_states: int
    inlined: bool
    feedthrough: bool
    fine: bool
    delayed: bool
    heated: bool
    lanes: int = 1

    def weights(self) -> dict[str, NDArray[np.uint8]]:
        """Return the kinds of all weights by name, each of the shape of its weights."""
        sizes = [int(np.prod(shape)) for shape in self.shapes]
        parts = np.split(np.frombuffer(self.kinds, np.uint8), np.cumsum(sizes)[:-1])
        names = [name for _, group in _WEIGHTS for name in group]
        return {name: part.reshape(shape) for name, part, shape in zip(names, parts, self.shapes, strict=True)}

    def wires(self) -> list[dict[str, int]]:
        """Return for each effect its site, and its numbers of _WIRING by name."""
        rows = whole(self.wiring).reshape(1 + len(_WIRING), -1).T.tolist() if self.inlined else []
        return [dict(zip(("site", *_WIRING), row, strict=True)) for row in rows]

    def text(self) -> str:
        """Return everything as text, which names the code on disk; a step goes by name and what it was made from."""
        return repr([[s.key for s in value] if name == "steps" else value for name, value in vars(self).items()])


def step_symbol(key: str) -> str:
    """Return the name under which the emitted code calls a step that is to be inlined."""
    return f"step.{key}"


def whole(numbers: bytes) -> NDArray[np.int64]:
    """Return the whole numbers (n,) of a part of a structure."""
    return np.frombuffer(numbers, np.int64)


def structure_of(parts: layout.Parts, *, inlined: bool) -> Structure:
    """Return the structure of the loop that these arguments need; with `inlined` all effects are part of it."""
    plant, hw, fx, ctl, mem, bus = parts
    weights = [getattr(getattr(parts, group), name) for group, names in _WEIGHTS for name in names]
    values = np.concatenate([w.ravel() for w in weights])
    kinds = np.full(values.size, ANY, dtype=np.uint8)
    kinds[values == 0.0], kinds[values == 1.0] = ZERO, ONE
    wiring = [np.repeat(np.arange(fx.first.size - 1), np.diff(fx.first)), *(getattr(fx, name) for name in _WIRING)]
    return Structure(
        shapes=tuple(w.shape for w in weights),
        kinds=kinds.tobytes(),
        plant=tuple(a.tobytes() for a in (plant.driven, plant.driven_by, plant.seen, plant.seen_mode)),
        sites=fx.site.tobytes(),
        wiring=np.array(wiring, dtype=np.int64).tobytes() if inlined else b"",
        steps=fx.steps if inlined else (),
        learning=(ctl.learning >= 0).tobytes(),
        n_columns=bus.source.size - 2 - sum(plant.d.shape),
        n_rates=fx.fast,
        n_parameters=fx.parameters.size if inlined else 0,
        n_states=fx.states.size if inlined else 0,
        inlined=inlined,
        feedthrough=bool(plant.feedthrough),
        fine=plant.substeps > 1,
        delayed=mem.queue.shape[1] > NO_DELAY,
        heated=bool(hw.heating[4] > 0.0),
    )
