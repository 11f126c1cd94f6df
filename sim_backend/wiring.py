"""Where the effects of a bench are connected: to which signals, coordinates and modes, in which order.

That follows from what they are and where they are alone, not from their numbers: benches that differ in numbers share
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backend import layout
from sim_backend.assembly import Places
from sim_backend.effects.base import Aux, Effect, Site
from sim_backend.effects.compiled import WIRES
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel
from sim_backend.modes import is_mode, mode_of, reach_of

Array = NDArray[np.float64]

WIRINGS_KEPT = 64
"""Different lists of effects whose wiring a process keeps: a study has one, a search over causes hundreds in turn."""


class _Put(NamedTuple):
    """A kind of effect at a location."""

    kind: type[Effect]
    where: str


@dataclass(frozen=True)
class _Wire:
    """Where one effect is connected: site, channel, coordinate it reads, inputs it writes, and its source channel."""

    site: Site
    index: int
    read: Array
    write: Array
    column: int


@dataclass(frozen=True)
class Connected:
    """Where effects are connected: which of them act on signals, in order, and their arrays but for their numbers."""

    order: tuple[int, ...]
    arrays: layout.Effects


def connected(effects: Sequence[Effect], places: Places, linear: ModalModel | None = None) -> Connected:
    """Return where effects are connected on a bench; raises ConfigError as `effects_of` does."""
    puts = tuple(_Put(type(e), e.where) for e in effects)
    if linear is not None and any(_is_to_mode(put, places) for put in puts):
        return _connected.__wrapped__(puts, places, linear)  # how it acts on a mode depends on numbers
    return _connected(puts, places, None)


def effects_of(
    effects: Sequence[Effect], places: Places, linear: ModalModel | None = None
) -> tuple[layout.Effects, list[Effect]]:
    """Return the effects that act on signals as arrays, and in the same order as objects (sorted by site).

    Exogenous columns are numbered in that order. Raises ConfigError when a `where` names no channel of the bench, nor
    a mode of its `linear` model.
    """
    return with_numbers(connected(effects, places, linear), effects)


def with_numbers(wired: Connected, effects: Sequence[Effect]) -> tuple[layout.Effects, list[Effect]]:
    """Return the arrays of connected effects with the numbers of these, which are at the same locations, in order."""
    made, ordered = wired.arrays, [effects[i] for i in wired.order]
    return made._replace(
        aux=made.aux.copy(),
        column=made.column.copy(),
        # one spare number each, so that the arrays have an address even when empty
        parameters=np.array([*(x for e in ordered for x in e.numbers()), 0.0]),
        states=np.concatenate([*(e.start() for e in ordered if e.n_state), np.zeros(1)]),
        cells=np.zeros(5),
    ), ordered


def require_place(effect: Effect, places: Places) -> None:
    """Raise ConfigError when the `where` of an effect on signals that is not played names no channel of the bench."""
    if effect.site <= Site.READING:
        _wire(_Put(type(effect), effect.where), places, None)


@lru_cache(maxsize=WIRINGS_KEPT)
def _connected(puts: tuple[_Put, ...], places: Places, linear: ModalModel | None) -> Connected:
    """Return where these are connected."""
    acting = [(_wire(put, places, linear), put, i) for i, put in enumerate(puts) if put.kind.site <= Site.READING]
    batches = _batches(acting)
    flat = [one for batch in batches for one in batch]
    wires, kinds = _of_one_width([w for w, _, _ in flat]), [put.kind for _, put, _ in flat]
    sites = np.array([int(w.site) for w in wires], dtype=np.int64)
    sizes = np.array([len(kind.parameters()) for kind in kinds], dtype=np.int64)
    states = np.array([kind.n_state for kind in kinds], dtype=np.int64)
    drawn = np.cumsum([kind.aux is Aux.EXOGENOUS for kind in kinds]) - 1
    column = [
        int(drawn[i]) if kind.aux is Aux.EXOGENOUS else w.column
        for i, (w, kind) in enumerate(zip(wires, kinds, strict=True))
    ]
    read = np.array([w.read for w in wires]).reshape(len(wires), wires[0].read.size if wires else len(places.outputs))
    coordinates, watched, fast = _coordinates(wires, kinds)
    levers, moved = _rows(
        [w.write for w in wires if w.site is Site.STRUCTURE],
        [w.write for w in wires],
        wires[0].write.size if wires else len(places.inputs),
    )
    arrays = layout.Effects(
        first=np.searchsorted(sites, np.arange(int(Site.READING) + 2)),
        site=np.searchsorted([int(batch[0][0].site) for batch in batches], np.arange(int(Site.READING) + 2)),
        batch=np.cumsum([0, *map(len, batches)]),
        steps=tuple(kind.step for kind in kinds),
        channel=np.array([w.index for w in wires], dtype=np.int64),
        p0=(np.cumsum(sizes) - sizes).astype(np.int64),
        s0=(np.cumsum(states) - states).astype(np.int64),
        aux=np.array([int(kind.aux) for kind in kinds], dtype=np.int64),
        column=np.array(column, dtype=np.int64),
        read=read,
        coordinates=coordinates,
        watched=watched,
        fast=fast,
        levers=levers,
        moved=moved,
        parameters=np.zeros(0),
        states=np.zeros(0),
        wires=np.zeros((len(wires), WIRES), dtype=np.int64),
        cells=np.zeros(0),
    )
    return Connected(tuple(i for _, _, i in flat), arrays)


def _coordinates(wires: Sequence[_Wire], kinds: Sequence[type[Effect]]) -> tuple[Array, layout.Ints, int]:
    """Return the coordinates that steps look at, whose they are, and of how many, the first, a rate is wanted too."""
    at_mid_step = [w.read for w in wires if w.site is Site.DRIVE]
    rates = at_mid_step + [w.read for w, kind in zip(wires, kinds, strict=True) if kind.step.reads("rate")]
    positions = [w.read for w, kind in zip(wires, kinds, strict=True) if kind.step.reads("position")]
    n_y = wires[0].read.size if wires else 0
    fast, _ = _rows(rates, [], n_y)
    return *_rows(rates + positions, [w.read for w in wires], n_y), fast.shape[0]


def _rows(needed: Sequence[Array], rows: Sequence[Array], width: int) -> tuple[Array, layout.Ints]:
    """Return the different ones of `needed`, in their order, and the number of each of `rows` among them, else 0."""
    kept = {row.tobytes(): row for row in needed}
    number = {key: i for i, key in enumerate(kept)}
    found = np.array([number.get(row.tobytes(), 0) for row in rows], dtype=np.int64)
    return np.array(list(kept.values()), dtype=float).reshape(len(kept), width), found


def _batches(acting: list[tuple[_Wire, _Put, int]]) -> list[list[tuple[_Wire, _Put, int]]]:
    """Return the effects, sorted by site, in groups of the same one at different locations.

    The effects of one channel keep their order, for each sees the signal that those before it leave. Torques on the
    structure add up and have no order.
    """
    batches: list[list[tuple[_Wire, _Put, int]]] = []
    for one in acting:
        wire, put, _ = one
        after, at = -1, (wire.site, wire.index)
        if wire.site is not Site.STRUCTURE:
            here = [i for i, batch in enumerate(batches) if any((w.site, w.index) == at for w, _, _ in batch)]
            after = max(here, default=-1)
        for batch in batches[after + 1 :]:
            if batch[0][0].site is wire.site and batch[0][1].kind is put.kind:
                batch.append(one)
                break
        else:
            batches.append([one])
    return sorted(batches, key=lambda batch: int(batch[0][0].site))


def _is_to_mode(put: _Put, places: Places) -> bool:
    """Tell whether an effect at a location that is not a channel acts on a mode."""
    target = put.where.rpartition("->")[2]
    channels = *places.inputs, *places.actuators
    return put.kind.site is Site.STRUCTURE and target not in channels and is_mode(target)


def _wire_to_mode(put: _Put, linear: ModalModel) -> _Wire:
    """Return the connection to a mode by itself, after the columns of the outputs and inputs."""
    m = mode_of(linear, put.where, put.kind.name)
    reach = reach_of(linear, m)
    read, write = np.zeros(linear.n_outputs + linear.n_blocks), np.zeros(linear.n_inputs + linear.n_blocks)
    read[linear.n_outputs + m], write[linear.n_inputs + m] = reach, linear.omega_rad_s[m] ** 2 / reach
    return _Wire(put.kind.site, 0, read, write, -1)


def _of_one_width(wires: list[_Wire]) -> list[_Wire]:
    """Return the wires with rows of one length: where one goes to a mode, those of the others go on with zeros."""
    n_read, n_write = (
        max((row.size for row in rows), default=0) for rows in ([w.read for w in wires], [w.write for w in wires])
    )
    return [replace(w, read=_longer(w.read, n_read), write=_longer(w.write, n_write)) for w in wires]


def _longer(row: Array, size: int) -> Array:
    return np.concatenate([row, np.zeros(size - row.size)])


def _wire(put: _Put, places: Places, linear: ModalModel | None) -> _Wire:
    kind = put.kind
    source, arrow, target = put.where.partition("->")
    target = target if arrow else source
    n_y, n_u = len(places.outputs), len(places.inputs)
    column = _source(put, source, places) if kind.aux in (Aux.SOURCE_COMMAND, Aux.SOURCE_POSITION) else -1
    nowhere = np.zeros(n_u)
    site = kind.site
    if target in places.actuators and site in (Site.COMMAND, Site.CURRENT, Site.STRUCTURE):
        i = places.actuators.index(target)
        lever = places.levers[i]
        if site is Site.STRUCTURE:
            return _Wire(site, int(np.argmax(np.abs(lever))), lever, lever, column)
        return _Wire(Site.CURRENT, i, lever, nowhere, column)
    if target in places.heads and site in (Site.HEAD, Site.READING):
        i = places.heads.index(target)
        return _Wire(Site.HEAD, i, places.sights[i], nowhere, column)
    if site in (Site.READING, Site.HEAD):
        i = places.find(places.outputs, target, kind.name)
        return _Wire(Site.READING, i, np.eye(n_y)[i], nowhere, column)
    if linear is not None and _is_to_mode(put, places):
        return _wire_to_mode(put, linear)
    i = places.find(places.inputs, target, kind.name)
    return _Wire(Site.COMMAND if site is Site.CURRENT else site, i, places.coordinates[i], np.eye(n_u)[i], column)


def _source(put: _Put, source: str, places: Places) -> int:
    if "->" not in put.where:
        raise ConfigError(
            f"effect {put.kind.name} goes from one channel to another; write where as 'source->target', not "
            f"'{put.where}'"
        )
    names = places.inputs if put.kind.aux is Aux.SOURCE_COMMAND else places.outputs
    return places.find(names, source, put.kind.name)
