"""The hidden plant: mechanical modes of a one- or two-axis bench, drawn at random, and its nominal model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_backend.model import Mode, Model, Port

Array = NDArray[np.float64]

AXES = ("theta_x", "theta_y")
_DRIVES = {"theta_x": "torque_x", "theta_y": "torque_y"}

NOMINAL_ERROR = 0.03
"""Every parameter of the nominal model is wrong by a uniformly drawn relative amount within ±3 %."""


@dataclass(frozen=True)
class Plant:
    """Modes d²q/dt² + 2 sigma dq/dt + omega² q = b u(t - delay), positions y = c q.

    Shapes: `omega_rad_s` and `sigma_1_s` (m,), `b` (m, n), `c` (n, m), `delay_s` (n,), `n` axes. Mode `i` < n is the
    suspension of axis `i`.
    """

    omega_rad_s: Array
    sigma_1_s: Array
    b: Array
    c: Array
    delay_s: Array

    @property
    def n_axes(self) -> int:
        """Number of axes."""
        return int(self.c.shape[0])

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return int(self.omega_rad_s.size)

    @property
    def stiffness(self) -> Array:
        """Static stiffness of each axis against its own drive, shape (n,)."""
        compliance = np.einsum("im,mi,m->i", self.c, self.b, 1.0 / self.omega_rad_s**2)
        return np.asarray(1.0 / compliance)

    def with_(self, **changes: Array) -> Plant:
        """Return a copy with the named arrays replaced."""
        return replace(self, **changes)

    def with_mode(self, omega_rad_s: float, sigma_1_s: float, b: Array, c: Array) -> Plant:
        """Return the plant with one more mode: `b` and `c` (n,)."""
        return Plant(
            np.append(self.omega_rad_s, omega_rad_s),
            np.append(self.sigma_1_s, sigma_1_s),
            np.vstack([self.b, b[None]]),
            np.hstack([self.c, c[:, None]]),
            self.delay_s,
        )

    def response(self, frequency_hz: Array) -> NDArray[np.complex128]:
        """Return the response in continuous time without the delay, shape (n_f, n, n)."""
        s = 2j * np.pi * frequency_hz[:, None]
        gain = 1.0 / (s**2 + 2.0 * self.sigma_1_s * s + self.omega_rad_s**2)
        return np.asarray(np.einsum("im,fm,mj->fij", self.c, gain, self.b))


def draw_plant(rng: np.random.Generator, n_axes: int) -> Plant:
    """Return a random plant: per axis a suspension at 15–50 Hz and a flexible mode at 4–9 times that.

    On two axes each mode moves the other axis a little.
    """
    omega = 2.0 * np.pi * rng.uniform(15.0, 50.0, n_axes)
    inertia = 3e-4 * np.exp(rng.uniform(-1.0, 1.0, n_axes))
    flexible = omega * rng.uniform(4.0, 9.0, n_axes)
    damping = np.concatenate([rng.uniform(0.015, 0.06, n_axes), rng.uniform(0.005, 0.03, n_axes)])
    share = rng.uniform(0.1, 0.6, n_axes) * rng.choice([-1.0, 1.0], n_axes)
    frequencies = np.concatenate([omega, flexible])
    b = np.vstack([np.diag(1.0 / inertia), np.diag(share / inertia)])
    c = np.hstack([np.eye(n_axes), np.eye(n_axes)])
    if n_axes > 1:
        foreign = rng.uniform(0.01, 0.05, c.shape) * rng.choice([-1.0, 1.0], c.shape)
        c = np.where(c == 0.0, foreign, c)
    return Plant(frequencies, damping * frequencies, b, c, np.zeros(n_axes))


def nominal_model(plant: Plant, rng: np.random.Generator, rate_hz: float, error: float = NOMINAL_ERROR) -> Model:
    """Return the model file that goes with a case: the plant's modes, each number wrong by up to `error`."""

    def wrong(value: float) -> float:
        return float(value * (1.0 + rng.uniform(-error, error)))

    axes = AXES[: plant.n_axes]
    modes = [
        Mode(
            label=f"mode {m + 1}",
            frequency_hz=wrong(plant.omega_rad_s[m] / (2.0 * np.pi)),
            decay_rate_1_s=wrong(plant.sigma_1_s[m]),
            input={_DRIVES[a]: wrong(plant.b[m, i]) for i, a in enumerate(axes) if plant.b[m, i] != 0.0},
            output={a: wrong(plant.c[i, m]) for i, a in enumerate(axes) if plant.c[i, m] != 0.0},
        )
        for m in range(plant.n_modes)
    ]
    return Model(
        name="nominal",
        title="nominal model of the bench",
        sample_rate_hz=rate_hz,
        inputs=[Port(name=_DRIVES[a], unit="N m", dof=a) for a in axes],
        outputs=[Port(name=a, unit="rad", dof=a) for a in axes],
        modes=modes,
    )
