"""What an extended model has otherwise than the one it extends, as the page of a diagnosis lists it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from analysis.pages.bode import per
from sim_backend.effects import effect_class
from sim_backend.model import EffectEntry, Mode, Model, Quantity, Value, number
from sim_backend.modes import units_at


@dataclass(frozen=True)
class Change:
    """One number that differs: where it stands, what it is, its values, the std of the last one, and the unit.

    `before` is that of the model given (None: it has none), `adjusted` that of the same with its own numbers fitted
    (None where it is not known), `after` that of the extended model.
    """

    place: str
    what: str
    before: float | None
    after: float
    std: float | None
    unit: str
    adjusted: float | None = None

    @property
    def relative(self) -> float | None:
        """Change of the extended model relative to the number given; None where there was none."""
        return (self.after - self.before) / self.before if self.before else None


@dataclass(frozen=True)
class _Number:
    """One number of a model: where it stands, what it is, its unit, its value, and the value as it is stated."""

    place: str
    what: str
    unit: str
    value: Value
    stated: Value


def changes(nominal: Model, extended: Model, adjusted: Model | None = None) -> list[Change]:
    """Return the numbers in which `extended` or `adjusted` differ from `nominal`, in the order of the file."""
    before = {(n.place, n.what): n for n in _linear(nominal)}
    middle = {(n.place, n.what): n for n in _linear(adjusted)} if adjusted is not None else {}
    rows = []
    for one in _linear(extended):
        key = (one.place, one.what)
        was, between = before.get(key), middle.get(key)
        values = [number(n.value) for n in (one, between) if n is not None]
        if was is None or any(number(was.value) != value for value in values):
            given, fitted = (None if n is None else n.stated for n in (was, between))
            rows.append(_change(one.place, one.what, given, one.stated, one.unit, fitted))
    gone = [entry for entry in nominal.effects if entry not in extended.effects]
    for entry in extended.effects:
        if entry in nominal.effects:
            continue
        old = _same(entry, gone)
        rows += [
            _change(f"{entry.effect} at {entry.where}", what, old.get(what), value, unit_of(entry, what, extended))
            for what, value in entry.parameters.items()
        ]
    return rows


def _same(entry: EffectEntry, among: Sequence[EffectEntry]) -> dict[str, Value]:
    """Return the parameters of the effect of the same kind at the same location; none where there is none."""
    found = (one for one in among if (one.effect, one.where) == (entry.effect, entry.where))
    return next((one.parameters for one in found), {})


def unit_of(entry: EffectEntry, parameter: str, model: Model) -> str:
    """Return the unit of an effect's parameter at its location in `model`; empty for a parameter it has not."""
    u, y = units_at(model, entry.where)
    for p in effect_class(entry.effect).parameters():
        if p.name == parameter:
            return p.dimension.unit(u, y)
    return ""


def _linear(model: Model) -> Iterator[_Number]:
    """Yield every number of the linear part of a model, in the order of its file."""
    for mode in model.modes:
        yield from _of_mode(mode, model)
    units = {port.name: port.unit for port in (*model.inputs, *model.outputs)}
    for out, row in model.feedthrough.items():
        for port, value in row.items():
            yield _Number(f"{out}, directly", f"gain from {port}", per(units[out], units[port]), value, value)
    for port, value in model.delay_s.items():
        yield _Number(f"input {port}", "delay", "s", value, value)


def _of_mode(mode: Mode, model: Model) -> Iterator[_Number]:
    """Yield every number of a mode; its decay rate is stated as a damping ratio.

    A mode moves in the unit of the output in which it is seen most.
    """
    place = mode.label
    yield _Number(place, "frequency", "Hz", mode.frequency_hz, mode.frequency_hz)
    zeta, std = mode.damping_ratio()
    if zeta is None:  # a rigid body
        yield _Number(place, "decay rate", "1/s", mode.decay_rate_1_s, mode.decay_rate_1_s)
    else:
        stated = Quantity(value=zeta, std=std) if std else zeta
        yield _Number(place, "damping ratio ζ (decay_rate_1_s ÷ 2πf)", "", mode.decay_rate_1_s, stated)
    units = {port.name: port.unit for port in (*model.inputs, *model.outputs)}
    most = max(mode.output, key=lambda name: abs(number(mode.output[name])), default="")
    own = units.get(most, "1")
    for what, table, driven in (
        ("gain from input", mode.input, f"{own}/s^2"),
        ("direct gain from input", mode.input_direct, f"{own}/s"),
    ):
        for port, value in table.items():
            yield _Number(place, f"{what} {port}", per(driven, units.get(port, "1")), value, value)
    for what, table, time in (
        ("share in output", mode.output, ""),
        ("share of the rate in output", mode.output_rate, "s"),
    ):
        for port, value in table.items():
            seen = units.get(port, "1")
            unit = f"{time} {'' if seen == own else per(seen, own)}".strip()
            yield _Number(place, f"{what} {port}", unit, value, value)


def _change(
    place: str, what: str, before: Value | None, after: Value, unit: str, adjusted: Value | None = None
) -> Change:
    std = after.std if isinstance(after, Quantity) else None
    given, between = (None if value is None else number(value) for value in (before, adjusted))
    return Change(place, what, given, number(after), std, unit, between)
