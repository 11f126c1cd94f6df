"""Controller ↔ file: what `mccd design` writes and the designed strategies play, with the model that it rests on.

One TOML file: the identified model, and for every designed axis its move, its feedback, its learning filter and how
long it learns. Feed-forward is not stored: it follows from the model for any two positions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
import tomli_w

from sim_backend.bench import MAX_TAPS, SIMULATED, UNNAMED, Bench
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.control.concentrated import concentrated_move
from sim_backend.control.repetitive import q_taps
from sim_backend.documents import read_text, toml_of
from sim_backend.errors import ConfigError
from sim_backend.model import Model, check_model

FILE_NAME = "controller.toml"

MOST_MOVE_SAMPLES = 100_000
"""Longest move: ten seconds of the chopper's bench, and seconds of work to shape."""

MOST_TAPS_ASIDE = (MAX_TAPS - 1) // 2
"""Taps of the low pass on either side that a bench can hold."""

MOST_WAIT_S = 600.0
"""Longest wait before learning: no mechanism rings for longer."""


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """Base of all tables: unknown fields are errors, defaults are not written."""


class Blocks(_Strict, frozen=True, kw_only=True):
    """A discrete filter as second-order blocks; see `sim_backend.control.blocks`."""

    a: list[list[list[float]]]
    b: list[list[float]]
    c: list[list[float]]
    d: float
    integrator: int | None = None

    @classmethod
    def of(cls, made: DiscreteFilter) -> Blocks:
        """Return the blocks of a filter."""
        return cls(a=made.a.tolist(), b=made.b.tolist(), c=made.c.tolist(), d=made.d, integrator=made.integrator)

    def filter(self, rate_hz: float) -> DiscreteFilter:
        """Return the filter; raises ConfigError when shapes do not fit."""
        if not (self.a or self.b or self.c):
            return DiscreteFilter(np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros((0, 2)), self.d, rate_hz)
        try:
            a, b, c = np.array(self.a, dtype=float), np.array(self.b, dtype=float), np.array(self.c, dtype=float)
        except ValueError:
            raise ConfigError("filter: its blocks have different lengths; give 2 × 2, 2 and 2 numbers each") from None
        return DiscreteFilter(a, b, c, self.d, rate_hz, self.integrator)


class AxisControl(_Strict, frozen=True, kw_only=True):
    """How one axis is controlled.

    A move of up to `reach_rad` takes `move_samples` with `concentration` (`sim_backend.control.concentrated`); a longer
    one takes longer by the root of its length, so that its torque is no larger. The feedback is always closed. After
    `wait_s` (whole periods, one at least) the input is learned for one period with each of `gains`, through `learning`
    with `lead_samples`, behind a low pass of `q_half_length` taps aside at `q_cutoff_hz`; then it is frozen. A period
    with gain 1 leaves `shrinks_to` of an error at most, or learning is stopped (`campaigns.strategies.watch`). What is
    learned begins with a feed-forward for a bench that answers `late_samples` after the model.
    """

    dof: str
    reach_rad: float
    move_samples: int
    concentration: float
    feedback: Blocks
    learning: Blocks
    lead_samples: int
    q_cutoff_hz: float
    q_half_length: int
    wait_s: float
    gains: list[float]
    shrinks_to: float = 0.5
    late_samples: float = 0.0

    def samples(self, distance_rad: float) -> int:
        """Return how many samples a move over a distance takes; raises ConfigError for more than a move may take."""
        longer = self.move_samples * math.sqrt(max(abs(distance_rad) / self.reach_rad, 1.0))
        if not longer <= MOST_MOVE_SAMPLES:
            raise ConfigError(
                f"axis '{self.dof}': a move of {abs(distance_rad):g} rad takes {longer:.3g} samples where one of "
                f"{self.reach_rad:g} rad takes {self.move_samples}, at most {MOST_MOVE_SAMPLES} are allowed; move "
                "less, or design a controller for longer moves"
            )
        return math.ceil(longer - 1e-9)


class DesignedFor(_Strict, frozen=True, kw_only=True):
    """The bench whose logs a controller was designed from; `serial` is empty where it is simulated."""

    name: str
    serial: str = ""

    @classmethod
    def of(cls, identity: Mapping[str, str]) -> DesignedFor | None:
        """Return the bench of an identity as logs hold it, None where that does not name one.

        The serial number of a simulated bench is its seed.
        """
        name = identity.get("name", "")
        if name in ("", UNNAMED):
            return None
        return cls(name=name, serial="" if identity.get("kind") in SIMULATED else identity.get("serial", ""))

    def __str__(self) -> str:
        return f"'{self.name}'" + (f" (serial number {self.serial})" if self.serial else "")


class Controller(_Strict, frozen=True, kw_only=True):
    """A whole controller file; `to_current` (n_a, n_axes) is that of the `bench` that it was designed for."""

    schema: Literal["mccd-controller/1"] = "mccd-controller/1"
    name: str
    sample_rate_hz: float
    model: Model
    axes: list[AxisControl]
    to_current: list[list[float]]
    bench: DesignedFor | None = None

    def axis(self, dof: str) -> AxisControl | None:
        """Return the control of an axis, None for one that was not designed."""
        return next((one for one in self.axes if one.dof == dof), None)

    def require_bench(self, bench: Bench) -> None:
        """Raise ConfigError for another bench than this controller was designed for, by name, units and coils."""
        here = DesignedFor.of(asdict(bench.identity))
        if None not in (self.bench, here) and self.bench != here:
            raise ConfigError(
                f"controller '{self.name}' was designed for the bench {self.bench}, this is {here}: nothing tells "
                "whether it has the modes of the model; design one for this bench (or, to try it all the same, take "
                "the table [bench] out of the file)"
            )
        units = {role: {s.dof: s.unit for s in bench.signals if s.role == role} for role in ("input", "output")}
        for role, ports in (("input", self.model.inputs), ("output", self.model.outputs)):
            for port in ports:
                if units[role].get(port.dof, port.unit) != port.unit:
                    raise ConfigError(
                        f"controller '{self.name}' is for an {role} {port.dof} in {port.unit}, the bench's is in "
                        f"{units[role][port.dof]}: it was designed for another bench; design one for this"
                    )
        own, theirs = np.array(self.to_current, dtype=float), bench.limits.to_current
        if not (own.shape == theirs.shape and np.allclose(own, theirs, rtol=0.1)):
            raise ConfigError(
                f"controller '{self.name}' was designed for {len(own)} coils with up to {np.abs(own).max():.3g} A per "
                f"unit of command, the bench has {len(theirs)} with up to {np.abs(theirs).max():.3g} A; design one for "
                "this bench"
            )


@lru_cache(maxsize=8)
def parse_controller(text: str, where: str) -> Controller:
    """Return the controller written in `text`; `where` names it in errors.

    A call with `text` and `where` of one of the last eight returns its object. Raises ConfigError for broken TOML,
    unknown fields, and values that no strategy could play.
    """
    try:
        found = msgspec.convert(toml_of(text, where, "write it with `mccd design`"), Controller)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{where}: {error}; write it with `mccd design`") from None
    check_model(found.model, where)
    if found.model.sample_rate_hz != found.sample_rate_hz:
        raise ConfigError(
            f"{where}: the controller is for {found.sample_rate_hz:g} Hz, its model for {found.model.sample_rate_hz:g} "
            "Hz; design it anew"
        )
    if not found.axes or len({one.dof for one in found.axes}) < len(found.axes):
        raise ConfigError(f"{where}: {len(found.axes)} axes; a controller needs one or more, each once")
    _check_coils(found.to_current, where)
    known = {p.dof for p in found.model.inputs} & {p.dof for p in found.model.outputs}
    for one in found.axes:
        if one.dof not in known:
            raise ConfigError(
                f"{where}, axis '{one.dof}': its model moves {', '.join(sorted(known)) or 'no axis'}, so that nothing "
                "tells whether this loop is stable; design it on a model of this axis"
            )
        _check(one, found.sample_rate_hz, where)
    return found


def _check_coils(to_current: list[list[float]], where: str) -> None:
    """Raise ConfigError unless every coil has one finite number for every axis: they tell a foreign bench."""
    lengths = sorted({len(row) for row in to_current})
    whole = len(lengths) == 1 and lengths[0] > 0
    if not (whole and all(math.isfinite(value) for row in to_current for value in row)):
        said = "a number that is not finite" if whole else f"{len(to_current)} rows of {lengths or 'no'} numbers"
        raise ConfigError(
            f"{where}: to_current has {said}; it needs one finite number per coil and axis, in A per unit of command: "
            "write it with `mccd design`"
        )


def _check(one: AxisControl, rate_hz: float, where: str) -> None:
    place = f"{where}, axis '{one.dof}'"
    if not one.gains or not all(math.isfinite(g) and 0.0 < g <= 1.0 for g in one.gains):
        raise ConfigError(f"{place}: learning gains {one.gains}; give one or more, each above zero and at most 1")
    if not 0.0 < one.shrinks_to < 1.0:
        raise ConfigError(f"{place}: shrinks_to is {one.shrinks_to}; what learns shrinks to a part between 0 and 1")
    if not (math.isfinite(one.reach_rad) and one.reach_rad > 0.0):
        raise ConfigError(f"{place}: reach_rad is {one.reach_rad}; it must be a finite number above zero")
    if not 0.0 <= one.wait_s <= MOST_WAIT_S or one.lead_samples < 0:
        raise ConfigError(
            f"{place}: a wait of {one.wait_s} s and a lead of {one.lead_samples} samples; neither may be negative, nor "
            f"the wait beyond {MOST_WAIT_S:g} s"
        )
    if not (math.isfinite(one.late_samples) and abs(one.late_samples) <= one.move_samples):
        raise ConfigError(f"{place}: late_samples is {one.late_samples}; a bench is not later than a move takes")
    if one.move_samples > MOST_MOVE_SAMPLES or one.q_half_length > MOST_TAPS_ASIDE:
        raise ConfigError(
            f"{place}: a move of {one.move_samples} samples and a low pass of {one.q_half_length} taps aside; at most "
            f"{MOST_MOVE_SAMPLES} and {MOST_TAPS_ASIDE} are allowed"
        )
    try:
        concentrated_move(one.move_samples, one.concentration)
        q_taps(one.q_cutoff_hz, one.q_half_length, rate_hz)
        one.feedback.filter(rate_hz)
        pole = float(np.max(np.abs(one.learning.filter(rate_hz).poles()), initial=0.0))
    except ConfigError as error:
        raise ConfigError(f"{place}: {error}") from None
    if not pole < 1.0:
        raise ConfigError(
            f"{place}: a pole of the learning filter is {pole:.4g} from zero, the limit is 1, or learning grows; "
            "design it anew"
        )


def load_controller(path: str | Path) -> Controller:
    """Return the controller in a file; raises ConfigError when there is none, it is too large, or as its parser."""
    return parse_controller(read_text(Path(path), "controller", fix="write one with `mccd design`"), str(path))


def dump_controller(controller: Controller) -> str:
    """Return the TOML text of a controller; `parse_controller` gives the same controller back."""
    return tomli_w.dumps(_without_none(msgspec.to_builtins(controller)))


def _without_none(node: object) -> dict[str, object]:
    assert isinstance(node, dict)
    return {k: _cleaned(v) for k, v in node.items() if v is not None}


def _cleaned(node: object) -> object:
    if isinstance(node, dict):
        return _without_none(node)
    return [_cleaned(v) for v in node] if isinstance(node, list) else node
