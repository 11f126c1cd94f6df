"""Benches of one to six modes and one to three axes, rigid ones too; and their nominal models, with wrong numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.second.law import log_uniform

Array = NDArray[np.float64]

NOMINAL_ERROR = 0.05
"""Every number of the nominal model is wrong by up to this part, uniformly. Delays are stated as they are: to be later
than stated is a listed effect."""

AXES = {"rad": ("theta_x", "theta_y", "theta_z"), "m": ("x", "y", "z")}
DRIVES = {"rad": "N m", "m": "N"}


@dataclass(frozen=True)
class Plant:
    """Modes q'' + 2 decay q' + ω² q = drive·u, y = shape·q.

    `omega` (m,) is in rad/s, `decay` (m,) in s⁻¹, `drive` (m, axes), `shape` (axes, m). The first modes are the axes'
    own; `unknown` counts those at the end that no nominal model holds. `delay_s` is between command and torque.
    """

    unit: str
    omega: Array
    decay: Array
    drive: Array
    shape: Array
    delay_s: float
    unknown: int = 0

    @property
    def axes(self) -> int:
        """How many axes there are."""
        return int(self.shape.shape[0])

    @property
    def names(self) -> tuple[str, ...]:
        """The degrees of freedom."""
        return AXES[self.unit][: self.axes]

    @property
    def known(self) -> int:
        """How many modes the nominal model holds."""
        return int(self.omega.size) - self.unknown

    def rigid(self, axis: int) -> bool:
        """Tell whether the axis has no stiffness of its own."""
        return bool(self.omega[axis] == 0.0)

    def beside(self, omega: float, decay: float, axis: int, part: float) -> Plant:
        """Return the plant with one more mode that no nominal model holds, with `part` of the drive of an axis."""
        drive, shape = np.zeros((1, self.axes)), np.zeros((self.axes, 1))
        drive[0, axis], shape[axis, 0] = part * self.drive[axis, axis], 1.0
        return Plant(
            self.unit,
            np.append(self.omega, omega),
            np.append(self.decay, decay),
            np.vstack([self.drive, drive]),
            np.hstack([self.shape, shape]),
            self.delay_s,
            self.unknown + 1,
        )


def draw_plant(rng: np.random.Generator, rate_hz: float, axes: int, rigid: bool, slowest_hz: float) -> Plant:
    """Return a random bench whose slowest mode is resolved by records from `slowest_hz` on.

    Own modes of the axes lie between 0.5 Hz and a fifteenth of the sample rate, flexible ones above up to 2 kHz;
    damping ratios are 0.001 to 0.7.
    """
    modes = min(6, axes + int(rng.integers(0, 4)))
    top = min(2000.0, 0.3 * rate_hz)
    low = max(0.5, slowest_hz)
    own_hz = [log_uniform(rng, low, max(1.5 * low, min(rate_hz / 15.0, 0.2 * top, 40.0 * low))) for _ in range(axes)]
    above = 3.0 * max(own_hz)
    flexible_hz = [log_uniform(rng, min(above, 0.7 * top), top) for _ in range(modes - axes)]
    omega = 2.0 * np.pi * np.array([*own_hz, *flexible_hz])
    ratio = [log_uniform(rng, 3e-3, 0.7) for _ in range(axes)] + [log_uniform(rng, 1e-3, 0.05) for _ in flexible_hz]
    decay = omega * np.array(ratio)
    if rigid:
        decay[0] = omega[0] * log_uniform(rng, 0.02, 0.5)
        omega[0] = 0.0
    inertia = log_uniform(rng, 1e-4, 10.0)
    drive, shape = np.zeros((modes, axes)), np.zeros((axes, modes))
    for a in range(axes):
        drive[a, a], shape[a, a] = 1.0 / (inertia * log_uniform(rng, 0.5, 2.0)), 1.0
        for b in range(axes):
            if b != a and rng.random() < 0.5:
                shape[b, a] = rng.uniform(-0.05, 0.05)
    for m in range(axes, modes):
        a = int(rng.integers(axes))
        drive[m, a], shape[a, m] = drive[a, a] * log_uniform(rng, 0.2, 1.5), 1.0
    period = 1.0 / rate_hz
    delay_s = float(rng.choice([0.0, period, 2.0 * period, period * rng.uniform(0.1, 2.5)]))
    return Plant("rad" if rng.random() < 0.6 else "m", omega, decay, drive, shape, delay_s)


def nominal_text(plant: Plant, rng: np.random.Generator, rate_hz: float) -> str:
    """Return the model file of the nominal plant: every number that is not zero is wrong."""

    def wrong(value: float) -> str:
        return repr(float(value) * (1.0 + rng.uniform(-NOMINAL_ERROR, NOMINAL_ERROR)))

    lines = ['schema = "mccd-model/1"', 'name = "nominal"', f"sample_rate_hz = {rate_hz!r}"]
    for kind, prefix, unit in (("inputs", "command_", DRIVES[plant.unit]), ("outputs", "", plant.unit)):
        for dof in plant.names:
            lines += ["", f"[[{kind}]]", f'name = "{prefix}{dof}"', f'unit = "{unit}"', f'dof = "{dof}"']
    for m in range(plant.known):
        lines += ["", "[[modes]]", f'label = "mode {m + 1}"']
        lines += [
            f"frequency_hz = {wrong(plant.omega[m] / (2.0 * np.pi))}",
            f"decay_rate_1_s = {wrong(plant.decay[m])}",
        ]
        lines += [f"input.command_{d} = {wrong(b)}" for d, b in zip(plant.names, plant.drive[m], strict=True) if b]
        lines += [f"output.{d} = {wrong(c)}" for d, c in zip(plant.names, plant.shape[:, m], strict=True) if c]
    if plant.delay_s:
        lines += ["", "[delay_s]", *(f"command_{d} = {plant.delay_s!r}" for d in plant.names)]
    return "\n".join(lines) + "\n"
