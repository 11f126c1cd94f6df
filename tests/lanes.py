"""How many benches the emitted loops play side by side, as tests see it."""

from __future__ import annotations

import pytest

from sim_backend.kernel import machine, side_by_side
from sim_backend.kernel.structure import Structure


def lanes_asked(monkeypatch: pytest.MonkeyPatch, *, there: bool = True) -> list[int]:
    """Return how many lanes each loop has that is asked for from now on; loops for several are all `there`, or none."""
    asked: list[int] = []
    loop_of = machine.loop_of

    def asking(structure: Structure) -> machine.Play:
        asked.append(structure.lanes)
        return loop_of(structure)

    monkeypatch.setattr(machine, "loop_of", asking)
    monkeypatch.setattr(side_by_side, "_is_there", lambda *_: there)
    return asked
