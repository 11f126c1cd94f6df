"""Plants that the identified one could be: its parameters drawn within their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.strategies.design import Design
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel
from sim_backend.model import Model, Quantity, Value

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tolerance:
    """Relative standard deviations added to what identification states, for what it cannot see.

    It states the scatter of one record, at one temperature and amplitude. The modulus of the structure changes by some
    1e-4 per kelvin, so that every `frequency` moves by 0.1 % over the thermal range; magnetic hysteresis moves that of
    the suspension, the lowest mode, by 1 % between the smallest motion and the largest. `damping` and `participation`
    are known worse.
    """

    frequency: float = 0.001
    suspension: float = 0.01
    damping: float = 0.05
    participation: float = 0.02

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0.0 <= value < 0.5:
                raise ConfigError(f"tolerance of {name} is {value}; it must lie between 0 and 0.5")


def drawn_plants(
    model: Model, dof: str, tolerance: Tolerance, count: int, rng: np.random.Generator
) -> list[ModalModel]:
    """Return `count` plants of one axis, the identified one first, each parameter independently Gaussian.

    Two real poles are not a mode, but of an amplifier or the like. Of frequency, damping and participation
    the file states what each alone is known to, which together is far better. Both poles move by the tolerance of
    damping instead, at the same gain at rest.
    """
    nominal = Design(model, model.sample_rate_hz).axis(dof)
    stated = _stated(model, dof, nominal)
    added = (tolerance.frequency, tolerance.damping, tolerance.participation)
    rings = nominal.sigma_1_s < nominal.omega_rad_s
    lowest = nominal.omega_rad_s == nominal.omega_rad_s[rings].min(initial=np.inf)
    stated = (np.hypot(stated[0], np.where(lowest, tolerance.suspension, 0.0)), *stated[1:])
    stds = [np.hypot(np.where(rings, own, 0.0), extra) for own, extra in zip(stated, added, strict=True)]
    plants = [nominal]
    for _ in range(count - 1):
        m = nominal.n_blocks
        frequency, damping, gain = (1.0 + std * rng.standard_normal(m) for std in stds)
        frequency = np.where(rings, frequency, np.maximum(damping, 0.1))
        gain = np.where(rings, gain, gain * frequency**2)
        plants.append(
            nominal.with_(
                omega_rad_s=nominal.omega_rad_s * frequency,
                sigma_1_s=nominal.sigma_1_s * np.maximum(damping, 0.1),
                c=nominal.c * gain,
                c_rate=nominal.c_rate * gain,
            )
        )
    return plants


def _stated(model: Model, dof: str, nominal: ModalModel) -> tuple[Array, Array, Array]:
    """Relative standard deviations (m,) of frequency, decay and participation that the file states, at most a third."""
    output = next(p.name for p in model.outputs if p.dof == dof)
    by_frequency = {
        round(2.0 * np.pi * _number(mode.frequency_hz), 9): (
            _relative(mode.frequency_hz),
            _relative(mode.decay_rate_1_s),
            _relative(mode.output.get(output, 0.0)),
        )
        for mode in model.modes
    }
    rows = [by_frequency.get(round(float(w), 9), (0.0, 0.0, 0.0)) for w in nominal.omega_rad_s]
    frequency, damping, gain = np.minimum(np.array(rows, dtype=float).reshape(-1, 3), 1.0 / 3.0).T
    return frequency, damping, gain


def _number(value: Value) -> float:
    return value.value if isinstance(value, Quantity) else float(value)


def _relative(value: Value) -> float:
    if not isinstance(value, Quantity) or value.std is None or value.value == 0.0:
        return 0.0
    return abs(value.std / value.value)
