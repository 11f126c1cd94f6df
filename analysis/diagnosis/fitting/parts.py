"""Axes that have nothing to do with each other: each is a fit of its own, smaller in samples, modes and nuisances.

Which inputs, modes and readings are joined follows from the numbers that are zero in the model, and from the channels
that effects read and act on. Noise is independent from reading to reading and so are all priors, so the whole misfit
is the sum of those of the parts, to the last digit that rounding leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.fitting.starts import Start
from analysis.diagnosis.noise.whitener import Bands, Whitener
from analysis.diagnosis.nominal.tuning import Nuisance
from sim_backend import layout
from sim_backend.assembly import Places, retuned
from sim_backend.effects.base import Aux, Effect

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

_NOTHING = 1e-9
"""A weight of the wiring this much smaller than the largest is rounding."""

_APART = 1e-6
"""How far a projection's eigenvalues may be from zero and one."""


@dataclass(frozen=True)
class Part:
    """What belongs together: numbers of readings, modes (those that candidates add last), nuisances and candidates."""

    outputs: Ints
    modes: Ints
    nuisances: Ints
    candidates: tuple[int, ...]
    known: tuple[Effect, ...]


def parts_of(setting: Setting, candidates: Sequence[Candidate], effects: Sequence[Effect]) -> list[Part]:
    """Return the parts into which a hypothesis falls, `effects` being its `candidates` with some values.

    One that does not fall apart has none. Raises ConfigError when an effect makes no model.
    """
    places, linear = setting.places, setting.nominal
    acting = [e.where for e in setting.known] + [c.where for c in candidates]
    needs = [*(e.aux for e in setting.known), *(c.effect.aux for c in candidates)]
    if Aux.TEMPERATURE in needs and any(record.temperature_k is None for record in setting.data.records):
        return []  # all currents heat alike
    wired = _wired(setting, acting)
    if wired is None:
        return []
    _, label = scipy.sparse.csgraph.connected_components(wired, directed=False)
    n_y = linear.n_outputs
    names = {name: int(label[n_y + j]) for j, name in enumerate(places.inputs)}
    names |= {name: int(label[o]) for o, name in enumerate(places.outputs)}
    there = list(dict.fromkeys(int(part) for part in label[:n_y]))  # what no reading shows goes with the first
    if len(there) < 2:
        return []

    def part_of(found: int) -> int:
        return there.index(found) if found in there else 0

    at = [part_of(names[where.rpartition("->")[2]]) for where in acting]
    added = _blocks_added(setting, effects)
    own = [part_of(int(label[np.argmax(row)])) if row.any() else 0 for row in _joined_by(setting)]
    modes = np.array(own + [at[len(setting.known) + i] for i, count in enumerate(added) for _ in range(count)])
    nuisances = np.array(
        [own[k.mode] if k.mode >= 0 else part_of(int(label[_port_of(k, n_y)])) for k in setting.nuisances]
    )
    return [
        Part(
            np.flatnonzero(label[:n_y] == found),
            np.flatnonzero(modes == p),
            np.flatnonzero(nuisances == p),
            tuple(i for i in range(len(candidates)) if at[len(setting.known) + i] == p),
            tuple(e for e, where in zip(setting.known, at, strict=False) if where == p),
        )
        for p, found in enumerate(there)
    ]


def _port_of(nuisance: Nuisance, n_y: int) -> int:
    """Return the number among readings, then inputs, of what a nuisance that belongs to no mode turns."""
    return n_y + nuisance.index[0] if nuisance.field == "delay_s" else nuisance.index[0]


def whole_of(setting: Setting, candidates: Sequence[Candidate]) -> Part:
    """Return a hypothesis that does not fall apart, as one part."""
    outputs, modes, nuisances = map(
        np.arange, (setting.nominal.n_outputs, setting.nominal.n_blocks, len(setting.nuisances))
    )
    return Part(outputs, modes, nuisances, tuple(range(len(candidates))), setting.known)


def _joined_by(setting: Setting) -> Mask:
    """Return which readings, then which inputs, each mode of the nominal model joins, shape (m, n_y + n_u)."""
    linear = setting.nominal
    seen = (linear.c != 0.0) | (linear.c_rate != 0.0)
    return np.concatenate([seen.T, (linear.b != 0.0) | (linear.b_direct != 0.0)], axis=1)


def _wired(setting: Setting, acting: Sequence[str]) -> Ints | None:
    """Return which readings and inputs, (n_y + n_u) of them, are joined; nothing where an effect acts in between.

    Effects on a single actuator or sensor head act on every axis.
    """
    places, linear = setting.places, setting.nominal
    n_y = linear.n_outputs
    groups = [*_joined_by(setting)]
    for o, j in np.argwhere(linear.d != 0.0):
        groups.append(_marked(n_y + linear.n_inputs, [int(o), n_y + int(j)]))
    through = np.abs(setting.transducers.to_torque @ setting.transducers.to_current)
    for where in acting:
        nodes: list[int] = []
        for name in where.split("->"):
            if name not in places.inputs and name not in places.outputs:
                return None
            if name in places.outputs:
                nodes.append(places.outputs.index(name))
            if name in places.inputs:
                j = places.inputs.index(name)
                nodes += [n_y + int(i) for i in np.flatnonzero(through[:, j] > _NOTHING * np.max(through))]
                nodes += [n_y + j, *np.flatnonzero(np.abs(places.coordinates[j]) > _NOTHING).tolist()]
        groups.append(_marked(n_y + linear.n_inputs, nodes))
    joined = np.array(groups, dtype=np.int64)
    return np.asarray(joined.T @ joined)


def _marked(size: int, nodes: Sequence[int]) -> Mask:
    row = np.zeros(size, dtype=bool)
    row[list(nodes)] = True
    return row


def _blocks_added(setting: Setting, effects: Sequence[Effect]) -> list[int]:
    """Return how many modes each effect adds."""
    counts, linear = [], setting.nominal
    for effect in effects:
        before, linear = linear.n_blocks, retuned(linear, [effect], setting.places)
        counts.append(linear.n_blocks - before)
    return counts


def setting_of(setting: Setting, part: Part) -> Setting | None:
    """Return the setting of one part by itself; nothing where the starts found so far join it to others."""
    at = part.outputs
    linear = setting.nominal
    own = linear.only(np.isin(np.arange(linear.n_blocks), part.modes))
    own = own.with_(c=own.c[at], c_rate=own.c_rate[at], d=own.d[at])
    records = tuple(r.only(at) for r in setting.data.records)
    starts = [_start_of(start, linear.n_outputs, part) for start in setting.starts]
    if any(start is None for start in starts):
        return None
    return replace(
        setting,
        data=replace(setting.data, records=records),
        nominal=own,
        known=part.known,
        places=_places_of(setting.places, at),
        transducers=_transducers_of(setting.transducers, at),
        nuisances=[_nuisance_of(setting.nuisances[k], part) for k in part.nuisances],
        whitener=_whitener_of(setting.whitener, at),
        starts=tuple(start for start in starts if start is not None),
        states=tuple(states[part.modes[part.modes < states.shape[0]]] for states in setting.states),
        added=tuple(Bands(b.edges, b.levels[at]) for b in setting.added),
        begin=None if setting.begin is None else setting.begin[part.nuisances],
    )


def _start_of(start: Start, n_outputs: int, part: Part) -> Start | None:
    """Return the directions of a start that lie in the rows of a part, orthonormal there.

    What starts add to separate parts are orthogonal spaces, so a basis of their sum, cut to one part's rows, has the
    inner products of a projection: its eigenvectors of eigenvalue one are that part's basis.
    """
    rows = start.q.reshape(n_outputs, -1, start.q.shape[1])[part.outputs].reshape(-1, start.q.shape[1])
    values, vectors = np.linalg.eigh(rows.T @ rows)
    whole = values > 0.5
    if np.any(np.minimum(np.abs(values), np.abs(values - 1.0)) > _APART):
        return None
    both = (2 * part.modes[:, None] + np.arange(2)).ravel()
    back = start.back[both[both < start.back.shape[0]]]
    return Start(rows @ vectors[:, whole], back @ vectors[:, whole], start.before @ vectors[:, whole])


def _places_of(places: Places, at: Ints) -> Places:
    return replace(
        places,
        outputs=tuple(places.outputs[o] for o in at),
        levers=places.levers[:, at],
        sights=places.sights[:, at],
        coordinates=places.coordinates[:, at],
    )


def _transducers_of(transducers: layout.Transducers, at: Ints) -> layout.Transducers:
    heads, reading = transducers.to_heads[:, at], transducers.to_reading[at]
    return transducers._replace(to_heads=np.ascontiguousarray(heads), to_reading=np.ascontiguousarray(reading))


def _nuisance_of(nuisance: Nuisance, part: Part) -> Nuisance:
    """Return a nuisance by the numbers that its mode and its reading have in the part."""
    if nuisance.field == "delay_s":
        return nuisance  # every part has all inputs
    mode = int(np.searchsorted(part.modes, nuisance.mode)) if nuisance.mode >= 0 else -1
    output = int(np.searchsorted(part.outputs, nuisance.index[0]))
    if nuisance.field in ("c", "c_rate"):
        return replace(nuisance, index=(output, mode), mode=mode)
    first = output if nuisance.field == "d" else mode
    return replace(nuisance, index=(first, *nuisance.index[1:]), mode=mode)


def _whitener_of(whitener: Whitener, at: Ints) -> Whitener:
    levels = whitener.levels[at] if whitener.levels.size else whitener.levels
    return replace(whitener, taps=np.ascontiguousarray(whitener.taps[at]), levels=levels)
