"""Sizes that are hardly true of a bench: a unit stated too large or too small, outputs in different units.

What is judged is the span of a whole record, largest less smallest. Of spans that are too small only the largest one of
a unit counts, and only of outputs that are driven: at rest, and beside the axis that is driven, an output may show
nothing but its noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.facts.base import Array, Fact, Seen

NAME = "size-ratio"


@dataclass(frozen=True)
class Plausible:
    """Least and most that channels in a unit span on a bench, in that unit, why, and two units that get confused.

    `beyond` names what spans the most, `within` what spans the least; `units` are the larger one and the smaller one.
    """

    least: float
    most: float
    within: str
    beyond: str
    units: tuple[str, str]


SPANS: Mapping[str, Plausible] = {
    "rad": Plausible(
        1e-6, math.pi, "the noise of an electronic autocollimator", "half a turn", ("degrees", "microradians")
    ),
    "m": Plausible(1e-9, 10.0, "the noise of a capacitive sensor", "the longest gantries", ("m", "µm")),
    "N m": Plausible(1e-9, 1e5, "the torque of a torsion balance", "the joints of the largest robots", ("N m", "mN m")),
    "N": Plausible(1e-9, 1e6, "the force on the tip of a force microscope", "the largest shakers", ("N", "mN")),
    "V": Plausible(1e-5, 3e3, "ten steps of a 24-bit converter of ±10 V", "low voltage, ±1500 V", ("V", "mV")),
    "A": Plausible(1e-9, 1e3, "the current of a photodiode", "the amplifiers of the largest shakers", ("A", "mA")),
    "K": Plausible(0.0, 1.5e3, "", "what is between cold and the melting point of steel", ("K", "mK")),
    "rad/s": Plausible(1e-8, 1e5, "the noise of a fibre gyroscope", "the fastest spindles", ("rad/s", "mrad/s")),
    "m/s": Plausible(1e-9, 340.0, "the noise of a seismometer", "the speed of sound", ("m/s", "mm/s")),
    "m/s^2": Plausible(
        1e-8, 1e6, "the noise of a seismic accelerometer", "the shock of an explosion", ("m/s^2", "mm/s^2")
    ),
}
"""By coherent SI unit. The least is what the noise of the best usual sensors spans (ten times its rms), or the least
that an actuator of any bench gives; a temperature may be as constant as it likes."""

DIFFERENT = 1e4
"""Ratio of the rms of outputs in one unit from which on it is remarked: degrees beside microradians make 1.7e4."""

BY_DRIVE = 10.0
"""What two axes may differ by in motion for a drive of one size, against that ratio: a loop holds one of them still."""


def doubts(seen: Seen, ends: Mapping[str, tuple[float, float]]) -> dict[str, str]:
    """Return, for each channel whose smallest and largest value (`ends`) are implausible in its unit, why."""
    span = {name: high - low for name, (low, high) in ends.items() if seen.channels[name].unit in SPANS}
    found: dict[str, str] = {}
    for name, width in span.items():
        limits = SPANS[seen.channels[name].unit]
        if width > limits.most:
            larger, smaller = limits.units
            found[name] = (
                f"its span is beyond {limits.beyond}: is the stated unit too large, {larger} for {smaller}, say?"
            )
    return found | _too_small(seen, span)


def _too_small(seen: Seen, span: Mapping[str, float]) -> dict[str, str]:
    found: dict[str, str] = {}
    if not _driven(seen):
        return found
    driven = {"input": seen.of_role("input"), "output": [one.name for one in _moved(seen)]}
    for role, names in driven.items():
        moving = [name for name in names if span.get(name, 0.0) > 0.0]
        for unit in dict.fromkeys(seen.channels[name].unit for name in moving):
            largest = max((name for name in moving if seen.channels[name].unit == unit), key=span.__getitem__)
            limits = SPANS[unit]
            if span[largest] < limits.least:
                larger, smaller = limits.units
                found[largest] = (
                    f"no {role} in {unit} spans more, and that is less than {limits.within}: is the stated unit too "
                    f"small, {smaller} for {larger}, say?"
                )
    return found


def _driven(seen: Seen) -> bool:
    """Tell whether anything is known to be driven: in a loop with a reference the inputs answer the noise as well."""
    played = seen.of_role("reference") or seen.of_role("input")
    return any(np.ptp(values) > 0.0 for values in played.values())


@dataclass(frozen=True)
class _Output:
    """An output: its rms about the mean, and the rms of the inputs of its degree of freedom, with their units."""

    name: str
    rms: float
    drive: float
    drive_units: frozenset[str]


def facts(seen: Seen) -> list[Fact]:
    """Return the outputs whose rms differs by orders of magnitude from that of the others in their unit."""
    found: list[Fact] = []
    if not _driven(seen):
        return found
    outputs = _moved(seen)
    for unit in dict.fromkeys(seen.channels[one.name].unit for one in outputs):
        alike = sorted((one for one in outputs if seen.channels[one.name].unit == unit), key=lambda one: one.rms)
        middle = alike[len(alike) // 2]
        found += [_fact(one, middle, unit) for one in alike if _apart(one, middle)]
    return found


def _moved(seen: Seen) -> Sequence[_Output]:
    """Return the outputs that are driven: by the inputs of their degree of freedom, or by any where none has one."""
    inputs = {name: _rms(values) for name, values in seen.of_role("input").items()}
    found = []
    for name, values in seen.of_role("output").items():
        own = [u for u in inputs if seen.channels[u].dof == seen.channels[name].dof]
        units = frozenset(seen.channels[u].unit for u in own)
        found.append(_Output(name, _rms(values), math.hypot(*(inputs[u] for u in own)), units))
    known = any(one.drive_units for one in found)
    return [one for one in found if one.rms > 0.0 and (one.drive > 0.0 or not known)]


def _rms(values: Array) -> float:
    """Return the rms about the mean, of a constant exactly zero: its mean may be rounded."""
    return float(values.std()) if np.ptp(values) > 0.0 else 0.0


def _apart(one: _Output, other: _Output) -> bool:
    """Tell whether two outputs differ, and by more than how differently they are driven."""
    ratio = one.rms / other.rms
    if 1.0 / DIFFERENT <= ratio <= DIFFERENT:
        return False
    if one.drive_units != other.drive_units or not one.drive_units:
        return True
    gain = ratio / (one.drive / other.drive)
    return not BY_DRIVE / DIFFERENT <= gain <= DIFFERENT / BY_DRIVE


def _fact(one: _Output, middle: _Output, unit: str) -> Fact:
    ratio = one.rms / middle.rms
    return Fact(
        NAME,
        f"{one.name} has {ratio:.3g} times the rms of {middle.name}, both in {unit}",
        "one of them is probably in another unit than stated: a model or diagnosis with both is wrong then",
        one.name,
        numbers={"ratio": ratio},
    )
