"""Fit of the paper's nonlinear model to recorded loops: Jiles–Atherton hysteresis and a polynomial, Table 6.3.

Quasi-statically the drive torque M and the angle x balance,

    M = K x + D dx/dt - size · J(x; a, pinning, c) - (p2 x² … without the linear term) - constant

with J the magnetisation along the measured path. All of it is linear but for the shapes of J, so these alone are
searched and the rest is solved for (variable projection).

Far from saturation (6.4) becomes dJ/dx = (chi x - J)/((1 + c) pinning) + chi c/(1 + c) with chi = ms/(3 a), and behind
a turning point dJ/dx = chi c/(1 + c) until J meets chi x. A record so tells the remanent torque
size · chi · pinning and the bend (1 + c) pinning, and no more: size · chi alone is a spring, as is the linear
coefficient of the polynomial. All but two of (size, a, ms, c, alpha, pinning) must be held.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite, positive
from sim_backend import kernel
from sim_backend.assembly import Places
from sim_backend.effects import make_effect
from sim_backend.errors import DataError
from sim_backend.wiring import effects_of

Array = NDArray[np.float64]

_PLACE = Places(("path",), ("path",), (), (), np.zeros((0, 1)), np.eye(1), np.eye(1))
_POWERS = (5, 4, 3, 2)
_STEP = 0.02  # of the logarithm of a shape: far above the steps that the division of the path leaves in J
_LOG_BOUNDS = (np.log(1e-9), np.log(9.0))  # far beyond what any path could show


@dataclass(frozen=True)
class LoopFit:
    """Parameters of the fit in SI, each with its standard deviation in `std` under the same name.

    `parameters`: the shapes that were searched (a and pinning in rad, c), size (N m), the polynomial by powers of the
    angle (`power_5` …, N m/rad⁵ …), stiffness (N m/rad), damping (N m s/rad) and constant (N m). `rms_nm` is the misfit
    of the torque, `linear_rms_nm` that of spring and damper alone. `starts_rms_nm` is what every start came to.
    """

    parameters: dict[str, float]
    std: dict[str, float]
    rms_nm: float
    linear_rms_nm: float
    starts_rms_nm: tuple[float, ...]

    @property
    def explained(self) -> float:
        """Part of the variance beyond spring and damper that the nonlinear model explains."""
        return 1.0 - (self.rms_nm / self.linear_rms_nm) ** 2


def magnetisation(angle_rad: ArrayLike, shapes: dict[str, float]) -> Array:
    """Return the torque (n,) per unit of size along a path (n,) that begins unmagnetised at zero; (6.4) and (6.5)."""
    path = finite("hysteresis path", angle_rad, 1)
    fx, _ = effects_of([make_effect("jiles-atherton", "path", {"size": 1.0, **shapes})], _PLACE)
    out, nothing = np.empty(path.size), np.zeros(path.size)
    kernel.contribution_along(fx, 0, nothing, path, nothing, nothing, 1e-4, out)
    return out


def fit_loops(
    torque_nm: ArrayLike,
    angle_rad: ArrayLike,
    rate_hz: float,
    held: dict[str, float],
    starts: list[dict[str, float]],
    use: ArrayLike | None = None,
) -> LoopFit:
    """Return the best fit over all `starts` of the shapes to a slow record (n,) that begins at rest, unmagnetised.

    Noise of the angle drives small loops of its own along the path: its sum of steps must stay far below the path's.
    `starts` name the shapes to search, above zero; `held` are the other parameters of the effect. `use` (n,) marks the
    samples that count; the path before them still magnetises. Raises DataError when lengths differ or fewer than 100
    count.
    """
    torque = finite("loop fit: torque", torque_nm, 1, least=100)
    angle = finite("loop fit: angle", angle_rad, 1, least=100)
    counts = np.ones(angle.size, dtype=bool) if use is None else np.asarray(use, dtype=bool)
    if torque.shape != angle.shape or counts.shape != angle.shape or np.sum(counts) < 100 or not starts:
        raise DataError(
            f"loop fit: torque {torque.shape}, angle {angle.shape}, {int(np.sum(counts))} samples that count, "
            f"{len(starts)} starts; give equal lengths, 100 samples and one start"
        )
    rate = positive("loop fit: the sample rate", rate_hz)
    if np.ptp(angle) == 0.0:
        raise DataError(f"loop fit: the angle stays at {angle[0]:g} rad; a loop needs a mirror that moves")
    problem = _Problem(torque, angle, rate, held, tuple(starts[0]), counts)
    found = [
        scipy.optimize.least_squares(
            problem.residual, problem.packed(start), bounds=_LOG_BOUNDS, diff_step=_STEP, max_nfev=60
        )
        for start in starts
    ]
    best = min(found, key=lambda solution: float(solution.cost))
    rms = tuple(float(np.sqrt(2.0 * s.cost / np.sum(counts))) for s in found)
    return problem.result(best.x, rms)


class _Problem:
    """The separable least-squares problem; the vector holds the logarithms of the shapes."""

    def __init__(
        self,
        torque: Array,
        angle: Array,
        rate_hz: float,
        held: dict[str, float],
        shapes: tuple[str, ...],
        use: NDArray[np.bool_],
    ) -> None:
        self._angle, self._held, self._shapes, self._use = angle, held, shapes, use
        self._torque = torque[use]
        unit = float(np.max(np.abs(angle)))
        self._names = ["stiffness", "damping", "constant", *(f"power_{p}" for p in _POWERS), "size"]
        self._scale = np.array([unit, 1.0, 1.0, *(unit**p for p in _POWERS), 1.0])
        x = angle / unit
        fixed = [x, np.gradient(angle) * rate_hz, np.ones(x.size), *(-(x**p) for p in _POWERS)]
        self._fixed = np.stack(fixed, axis=1)[use]

    def packed(self, start: dict[str, float]) -> Array:
        return np.log([start[name] for name in self._shapes])

    def _design(self, packed: Array) -> Array:
        shapes = dict(zip(self._shapes, np.exp(packed), strict=True))
        column = -magnetisation(self._angle, {**self._held, **shapes})[self._use]
        return np.column_stack([self._fixed, column])

    def residual(self, packed: Array) -> Array:
        """Misfit of the torque after everything linear has been solved for."""
        design = self._design(packed)
        return self._torque - design @ _solved(design, self._torque)

    def result(self, packed: Array, starts: tuple[float, ...]) -> LoopFit:
        design = self._design(packed)
        linear = _solved(design, self._torque)
        residual = self._torque - design @ linear
        names = [*self._shapes, *self._names]
        values = np.concatenate([np.exp(packed), linear / self._scale])
        spring = self._fixed[:, :3]
        plain = self._torque - spring @ _solved(spring, self._torque)
        std = self._deviations(packed, design, linear, residual) / np.concatenate([1.0 / np.exp(packed), self._scale])
        return LoopFit(
            dict(zip(names, map(float, values), strict=True)),
            dict(zip(names, map(float, std), strict=True)),
            float(np.sqrt(np.mean(residual**2))),
            float(np.sqrt(np.mean(plain**2))),
            starts,
        )

    def _deviations(self, packed: Array, design: Array, linear: Array, residual: Array) -> Array:
        """Standard deviations of (ln shapes, scaled linear), from the Jacobian and the misfit as coloured noise."""
        slopes = [
            (self._design(packed + e) - self._design(packed - e)) @ linear / (2.0 * _STEP)
            for e in _STEP * np.eye(packed.size)
        ]
        jacobian = np.column_stack([*slopes, design])
        size = np.maximum(np.linalg.norm(jacobian, axis=0), np.finfo(float).tiny)
        covariance = np.linalg.inv((jacobian / size).T @ (jacobian / size))
        # neighbours that agree hold less information: by the sum of the correlations until they have died away
        lags = [residual[k:] @ residual[:-k] / (residual @ residual) for k in range(1, 20)]
        colour = max(1.0 + 2.0 * float(np.sum(lags)), 1.0)
        noise = colour * (residual @ residual) / max(residual.size - jacobian.shape[1], 1)
        return np.sqrt(np.maximum(np.diag(covariance), 0.0) * noise) / size


def _solved(design: Array, target: Array) -> Array:
    size = np.linalg.norm(design, axis=0)
    size[size == 0.0] = 1.0
    return np.linalg.lstsq(design / size, target, rcond=1e-12)[0] / size
