"""A model as a difference against another: every number that changed, with where the new one comes from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from sim_backend.effects import effect_class
from sim_backend.model import EffectEntry, Mode, Model, Quantity, Value, number
from sim_backend.modes import units_at


@dataclass(frozen=True)
class Change:
    """One number that differs: where it stands, what it is, before (None: it is new), after, its std and unit."""

    place: str
    what: str
    before: float | None
    after: float
    std: float | None
    unit: str

    @property
    def relative(self) -> float | None:
        """Change relative to the number before; None where there was none."""
        return (self.after - self.before) / self.before if self.before else None


def changes(nominal: Model, extended: Model) -> list[Change]:
    """Return the numbers of `extended` that `nominal` has not, or has otherwise, in the order of the file."""
    rows = []
    old_modes: dict[str, Mode] = {mode.label: mode for mode in nominal.modes}
    for mode in extended.modes:
        old = old_modes.get(mode.label)
        before = dict(_of_mode(old)) if old else {}
        for (what, unit), value in _of_mode(mode):
            was = before.get((what, unit))
            if was is None or number(was) != number(value):
                rows.append(_change(mode.label, what, was, value, unit))
    for out, row in extended.feedthrough.items():
        was_row = nominal.feedthrough.get(out, {})
        rows += [
            _change(f"{out}, directly", f"driven by {port}", was_row.get(port), value, "")
            for port, value in row.items()
            if port not in was_row or number(was_row[port]) != number(value)
        ]
    kept = list(nominal.effects)
    for entry in extended.effects:
        if entry in kept:
            continue
        rows += [
            _change(f"{entry.effect} at {entry.where}", what, None, v, unit_of(entry, what, extended))
            for what, v in entry.parameters.items()
        ]
    return rows


def unit_of(entry: EffectEntry, parameter: str, model: Model) -> str:
    """Return the unit of an effect's parameter at its place in `model`; empty for a parameter it has not."""
    u, y = units_at(model, entry.where)
    for p in effect_class(entry.effect).parameters():
        if p.name == parameter:
            return p.dimension.unit(u, y)
    return ""


def _of_mode(mode: Mode) -> Iterator[tuple[tuple[str, str], Value]]:
    yield ("frequency", "Hz"), mode.frequency_hz
    yield ("decay rate", "1/s"), mode.decay_rate_1_s
    for what, table in (
        ("driven by", mode.input),
        ("driven directly by", mode.input_direct),
        ("seen in", mode.output),
        ("rate seen in", mode.output_rate),
    ):
        for port, value in table.items():
            yield (f"{what} {port}", ""), value


def _change(place: str, what: str, before: Value | None, after: Value, unit: str) -> Change:
    std = after.std if isinstance(after, Quantity) else None
    return Change(place, what, None if before is None else number(before), number(after), std, unit)
