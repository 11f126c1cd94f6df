"""The table of addresses and whole numbers that an emitted loop receives, by name."""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import numpy as np

from sim_backend import layout
from sim_backend.addresses import address_of_numbers
from sim_backend.kernel.called import gate, learn
from sim_backend.machine_code import address_of

BUS = ("source", "driven", "current", "torque", "head", "reading", "at", "speed", "middle", "force")
"""Signals of one sample that effects read and change."""
COPIED = ("parameters", "x", "past", "acting", "xf", "states")
"""Arrays that the loop works on in a copy of its own; all but the first are copied back."""
RECORDED = ("command", "torque", "current", "position", "reading", "head", "temperature")
"""Signals that are kept, in tables of so many columns as there are samples."""

_ARRAYS: dict[str, tuple[str, ...]] = {
    "plant": ("a", "b", "push", "c", "d", "rate_d", "delay_first", "delay_taps"),
    "hw": ("to_current", "to_torque", "to_heads", "to_reading", "heating"),
    "fx": ("batch", "coordinates", "levers", "parameters", "states", "wires"),
    "ctl": ("fa", "fb", "fc", "fd", "integrator", "period", "lead", "learning", "taps", "gain", "la", "lb", "lc", "ld"),
    "wave": ("reference", "feedforward", "events", "exogenous"),
    "mem": ("x", "past", "has_past", "queue", "acting", "xf", "xl", "closed", "ring", "learned", "temperature"),
    "bus": BUS,
    "out": RECORDED,
}
_PICK = {group: attrgetter(*names) for group, names in _ARRAYS.items()}
_PREFIXED = {"ctl": "ctl.", "out": "out."}  # their names occur elsewhere, too
_FIXED_NUMBERS = ("address", "learn", "substeps", "depth", "n_blocks", "n_blocks_l", "n_taps", "length")
_NUMBERS = ("n", "gate", "samples", "first", "period", "n_events", "n_drawn", *(f"columns.{name}" for name in RECORDED))


def _names(*groups: str) -> list[str]:
    return [_PREFIXED.get(g, "") + name for g in groups for name in _ARRAYS[g]]


TABLE = (*_names(*layout.Parts._fields), *_FIXED_NUMBERS, *_names("wave", "out"), *_NUMBERS)
"""Names of the table's entries, in order: what stays with a bench, then what a run brings."""


def fixed_entries(parts: layout.Parts, steps: layout.Ints) -> list[int]:
    """Return the part of the table that stays with a bench; `steps` (n_e,) are the addresses of its effects' steps."""
    plant, _, _, ctl, mem, _ = parts
    learns = address_of(learn) if np.any(ctl.learning >= 0) else 0  # what nothing calls need not be compiled
    numbers = [address_of_numbers(steps), learns, plant.substeps, mem.queue.shape[1]]
    numbers += [ctl.fb.shape[1], ctl.lb.shape[1], ctl.taps.shape[1], mem.ring.shape[1]]
    return [*_addresses(**parts._asdict()), *numbers]


def entries(n: int, wave: layout.Waveform, mem: layout.Memory, out: layout.Output) -> list[int]:
    """Return the part of the table that a run of `n` samples brings."""
    gates = address_of(gate) if wave.events.shape[0] else 0
    numbers = [n, gates, int(mem.samples[0]), out.first, wave.reference.shape[0], wave.events.shape[0]]
    numbers += [wave.exogenous.shape[1], *(getattr(out, name).shape[-1] for name in RECORDED)]
    return [*_addresses(wave=wave, out=out), *numbers]


def _addresses(**groups: Any) -> list[int]:
    return [address_of_numbers(array) for g, group in groups.items() for array in _PICK[g](group)]
