"""Numbers that no bench can have: refused when a model is read, before they become infinities or divisions by zero."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sim_backend.errors import ConfigError

LARGEST = 1e18
"""In SI. Gains and spring rates of real benches stay far below, and products of a dozen such numbers are finite."""

SLOWEST_HZ = 1e-6
SMALLEST = 1e-12
POSITIVE = frozenset(
    {
        "actuators.radius_m",
        "sensors.radius_m",
        "force_constant_n_a",
        "actuator_steepness_n_sqrt_w",
        "peak_current_a",
        "continuous_force_n",
        "end_stop_angle_rad",
        "end_stop_z_m",
        "thermal_time_constant_s",
    }
)
"""Numbers of the hardware that something is divided by, or that are a size: at least SMALLEST in SI."""

NOT_NEGATIVE = frozenset({"cold_finger_k", "thermal_resistance_k_w", "theodolite_noise_rad"})


def refuse_absurd(model: dict[str, Any], where: str) -> None:
    """Raise ConfigError, naming the number, its value and the limit, if the plain content of a model holds one."""
    for place, value in () if _all_finite(model) else _numbers(model, ""):
        if not abs(value) <= LARGEST:
            raise ConfigError(f"{where}: {place} is {value:g}; every number must be finite and at most {LARGEST:g}")
    rate_hz = model["sample_rate_hz"]
    if rate_hz < SLOWEST_HZ:
        raise ConfigError(f"{where}: sample_rate_hz is {rate_hz:g}; it must be at least {SLOWEST_HZ:g}")
    for place, value in _numbers(model.get("hardware") or {}, ""):
        name = place.removesuffix(".value")
        lowest = SMALLEST if name in POSITIVE else 0.0 if name in NOT_NEGATIVE else -LARGEST
        if value < lowest:
            raise ConfigError(f"{where}: hardware.{name} is {value:g}; it must be at least {lowest:g}")


def refuse_contradiction(hardware: dict[str, Any], where: str) -> None:
    """Raise ConfigError, naming both numbers and what to state instead, where limits of the hardware cannot both hold.

    An effect may contradict them: an amplifier that saturates below its peak current, and a stop within the travel,
    are what a diagnosis finds.
    """
    stated = {place.removesuffix(".value"): value for place, value in _numbers(hardware, "")}
    constant, peak_a = stated["force_constant_n_a"], stated["peak_current_a"]
    lasting, most = stated["continuous_force_n"], constant * peak_a
    # one part in 1e9 is rounding of a product, no contradiction
    if lasting > most * (1.0 + 1e-9):
        raise ConfigError(
            f"{where}: hardware.continuous_force_n is {lasting:g} N, but a peak current of {peak_a:g} A gives {most:g} "
            f"N with {constant:g} N/A; state at most {most:g} N, or a peak current of {lasting / constant:g} A or more"
        )


def _all_finite(model: dict[str, Any]) -> bool:
    """Tell whether no number is larger than it may be, without naming its path: most models are sound."""
    below: list[Any] = [model]
    for node in below:
        kind = type(node)  # plain content holds no other kinds, and asking so is quickest
        if kind is dict:
            below.extend(node.values())
        elif kind is list:
            below.extend(node)
        elif (kind is float or kind is int) and not abs(node) <= LARGEST:
            return False
    return True


def _numbers(node: object, place: str) -> Iterator[tuple[str, float]]:
    """Yield the path and the value of every number."""
    if isinstance(node, dict | list):
        items = node.items() if isinstance(node, dict) else enumerate(node)
        for key, value in items:
            yield from _numbers(value, f"{place}.{key}" if place else str(key))
    elif isinstance(node, float | int):
        yield place, float(node)
