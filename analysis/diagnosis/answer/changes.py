"""What an extended model has otherwise than the one it extends, as the page of a diagnosis lists it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from analysis.pages.bode import per
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
        before = {what: (value, told) for what, _, value, told in _of_mode(old, nominal)} if old else {}
        for what, unit, value, told in _of_mode(mode, extended):
            was, told_was = before.get(what, (None, None))
            if was is None or number(was) != number(value):
                rows.append(_change(mode.label, what, told_was, told, unit))
    units = {port.name: port.unit for port in (*extended.inputs, *extended.outputs)}
    for out, row in extended.feedthrough.items():
        was_row = nominal.feedthrough.get(out, {})
        rows += [
            _change(f"{out}, directly", f"driven by {port}", was_row.get(port), value, per(units[out], units[port]))
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
    """Return the unit of an effect's parameter at its location in `model`; empty for a parameter it has not."""
    u, y = units_at(model, entry.where)
    for p in effect_class(entry.effect).parameters():
        if p.name == parameter:
            return p.dimension.unit(u, y)
    return ""


def _of_mode(mode: Mode, model: Model) -> Iterator[tuple[str, str, Value, Value]]:
    """Yield every number of a mode: name, unit, value, and how it is stated: a decay rate as damping ratio.

    A mode moves in the unit of the output in which it is seen most.
    """
    yield "frequency", "Hz", mode.frequency_hz, mode.frequency_hz
    zeta, std = mode.damping_ratio()
    if zeta is None:  # a rigid body
        yield "decay rate", "1/s", mode.decay_rate_1_s, mode.decay_rate_1_s
    else:
        told = Quantity(value=zeta, std=std) if std else zeta
        yield "damping ratio ζ", "", mode.decay_rate_1_s, told
    units = {port.name: port.unit for port in (*model.inputs, *model.outputs)}
    most = max(mode.output, key=lambda name: abs(number(mode.output[name])), default="")
    own = units.get(most, "1")
    for what, table, driven in (
        ("driven by", mode.input, f"{own}/s^2"),
        ("driven directly by", mode.input_direct, f"{own}/s"),
    ):
        for port, value in table.items():
            yield f"{what} {port}", per(driven, units.get(port, "1")), value, value
    for what, table, time in (("seen in", mode.output, ""), ("rate seen in", mode.output_rate, "s")):
        for port, value in table.items():
            seen = units.get(port, "1")
            yield f"{what} {port}", f"{time} {'' if seen == own else per(seen, own)}".strip(), value, value


def _change(place: str, what: str, before: Value | None, after: Value, unit: str) -> Change:
    std = after.std if isinstance(after, Quantity) else None
    return Change(place, what, None if before is None else number(before), number(after), std, unit)
