"""The addresses by which effects that are called find their signals; inlined ones need none."""

from __future__ import annotations

import numpy as np

from sim_backend import layout
from sim_backend.addresses import address_of_numbers
from sim_backend.effects.base import Aux, Site


def wired(fx: layout.Effects, bus: layout.Bus) -> layout.Effects:
    """Return the effects connected to the signals of a bus; both must be kept as long as they are used."""
    signals = {
        Site.COMMAND: bus.driven,
        Site.CURRENT: bus.current,
        Site.DRIVE: bus.torque,
        Site.STRUCTURE: bus.torque,
        Site.HEAD: bus.head,
        Site.READING: bus.reading,
    }
    first_source = {
        Aux.NONE: 0,
        Aux.TEMPERATURE: 1,
        Aux.SOURCE_COMMAND: 2,
        Aux.SOURCE_POSITION: 2 + bus.driven.size,
        Aux.EXOGENOUS: 2 + bus.driven.size + bus.reading.size,
    }
    wires = np.zeros_like(fx.wires)
    for site, signal in signals.items():
        at = slice(fx.first[site], fx.first[site + 1])
        if at.start == at.stop:  # most sites of most benches: a search wires one or two effects some thousand times
            continue
        wires[at, 0] = wires[at, 4] = _addresses(signal, fx.channel[at])
        wires[at, 1] = _addresses(bus.middle if site is Site.DRIVE else bus.at, fx.watched[at])
        if site is Site.STRUCTURE:
            wires[at, 4] = _addresses(bus.force, fx.moved[at])
    source = np.array([first_source[Aux(kind)] for kind in fx.aux], dtype=np.int64)
    has_column = (fx.aux != int(Aux.NONE)) & (fx.aux != int(Aux.TEMPERATURE))
    wires[:, 2] = _addresses(bus.speed, np.where(fx.watched < fx.fast, fx.watched, 0))
    wires[:, 3] = _addresses(bus.source, source + np.where(has_column, fx.column, 0))
    wires[:, 5], wires[:, 6] = _addresses(fx.parameters, fx.p0), _addresses(fx.states, fx.s0)
    return fx._replace(wires=wires)


def _addresses(array: layout.Array, index: layout.Ints) -> layout.Ints:
    return np.asarray(address_of_numbers(array) + array.itemsize * index, dtype=np.int64)
