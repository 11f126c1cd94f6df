"""What an instrument beside the bench tells of its sensors: reading minus true angle, which only sensor effects change.

A gain of the sensor and a gain of the drive move the readings alike, so that no reading tells them apart; a second
instrument does, because it sees the angle itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.fit import Setting
from analysis.diagnosis.hypotheses import Hypothesis
from analysis.diagnosis.noise import Whitener
from analysis.diagnosis.planned import Played, Room, play_on_paper
from campaigns.plans import Plan
from sim_backend.bench import Bench
from sim_backend.errors import ConfigError
from sim_backend.model import Model, number

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

_STEP = 1e-3
"""Relative step by which a parameter is changed to see what that does to the readings: sensor effects are near linear
over it, and it is far above rounding."""

_ITERATIONS = 3
"""Gauss-Newton steps: a gain of the sensor enters the angles of a closed loop as 1/(1 + gain), and three are enough to
be exact there."""


def watched_outputs(plan: Plan, bench: Bench, model: Model) -> tuple[int, ...]:
    """Return the numbers of the outputs that `plan` records together with an independent instrument's channel.

    That is an auxiliary channel of the output's degree of freedom in its unit. None when the instrument's noise is not
    known to `model`.
    """
    if model.hardware is None or model.hardware.theodolite_noise_rad is None:
        return ()
    kept = [s for s in bench.signals if s.name in plan.channels(bench)]
    beside = {(s.dof, s.unit) for s in kept if s.role == "aux"}
    read = {s.dof for s in kept if s.role == "output"}
    return tuple(o for o, p in enumerate(model.outputs) if (p.dof, p.unit) in beside and p.dof in read)


@dataclass(frozen=True)
class Witness:
    """A plan that an instrument watches on a bench, with what is needed to play it on paper."""

    plan: Plan
    bench: Bench
    model: Model
    setting: Setting
    room: Room

    @property
    def watched(self) -> tuple[int, ...]:
        """Return the numbers of the outputs that the instrument watches."""
        return watched_outputs(self.plan, self.bench, self.model)

    def separation(self, first: Played, second: Hypothesis) -> float:
        """Return by how many sigma the instrument tells what `first` shows from `second`; 0 when it watches nothing."""
        watched = self.watched
        return self.misfit(error_of(first, watched), second) if watched else 0.0

    def misfit(self, error: Array, hypothesis: Hypothesis) -> float:
        """Return the root of the sum of squares with which `hypothesis` explains `error` (n, k) of the watched outputs.

        Its parameters adapt as far as their standard deviations let them, by Gauss-Newton steps; an offset between
        instrument and sensor is free. Infinite for a hypothesis that cannot play the plan within the limits.
        """
        fit = hypothesis.fit
        free = np.flatnonzero(np.isfinite(fit.std) & (fit.std > 0.0))
        precision = np.diag(1.0 / fit.std[free] ** 2)
        moved = np.zeros(free.size)
        total = float("inf")
        for _ in range(_ITERATIONS + 1):
            left = self._at(error, hypothesis, free, moved)
            if left is None:
                break
            total = min(total, float(left @ left + moved @ precision @ moved))
            columns = self._slopes(error, hypothesis, free, moved, left)
            normal = columns.T @ columns + precision
            moved = moved + np.linalg.solve(normal, columns.T @ left - precision @ moved)
        return float(np.sqrt(total))

    def _slopes(self, error: Array, hypothesis: Hypothesis, free: Ints, moved: Array, here: Array) -> Array:
        """Return by how much what is left shrinks per unit of each free parameter, whitened, (rows, k)."""
        columns = np.zeros((here.size, free.size))
        for k, i in enumerate(free):
            step = _STEP * (abs(float(hypothesis.fit.values[i])) or float(hypothesis.fit.std[i]))
            beside = self._at(error, hypothesis, free, moved + step * np.eye(free.size)[k])
            if beside is not None:
                columns[:, k] = (here - beside) / step
        return columns

    def _at(self, error: Array, hypothesis: Hypothesis, free: Ints, moved: Array) -> Array | None:
        """Return what is left of `error` with the parameters moved, whitened; None when that cannot be played."""
        try:
            changed = _changed(hypothesis, free, moved)
        except ConfigError:
            return None
        played = play_on_paper(self.plan, self.bench, self.model, changed, self.setting, self.room)
        if played is None:
            return None
        left = error - error_of(played, self.watched)
        return whitened_error(left, self.watched, self.setting.whitener, self.model)


def _changed(hypothesis: Hypothesis, free: Ints, moved: Array) -> Hypothesis:
    """Return the hypothesis with its free parameters moved; raises ConfigError beyond their bounds."""
    fit = hypothesis.fit
    values = fit.values.copy()
    values[free] += moved
    effects = list(fit.effects)
    for (owner, name), value in zip(fit.names, values, strict=True):
        changed: dict[str, Any] = {name: float(value)}
        effects[owner] = replace(effects[owner], **changed)
    return replace(hypothesis, fit=replace(fit, effects=tuple(effects)))


def error_of(played: Played, watched: tuple[int, ...]) -> Array:
    """Return reading minus true position (n, k) of the watched outputs."""
    return np.asarray((played.record.y - played.position)[:, watched], dtype=float)


def whitened_error(error: Array, watched: tuple[int, ...], whitener: Whitener, model: Model) -> Array:
    """Return `error` (n, k) of the watched outputs in numbers of unit variance, (2 n k,): real and imaginary parts.

    Its noise is that of the readings plus the instrument's, which is white; their mean, an offset, is left out.
    """
    assert model.hardware is not None and model.hardware.theodolite_noise_rad is not None
    own = number(model.hardware.theodolite_noise_rad) ** 2
    n = error.shape[0]
    lines = np.fft.fft(error, axis=0) / np.sqrt(n)
    frequency = np.abs(np.fft.fftfreq(n))
    parts = []
    for k, o in enumerate(watched):
        power = 1.0 / np.maximum(np.abs(np.fft.fft(whitener.taps[o], n)) ** 2, np.finfo(float).tiny)
        if whitener.levels.size:
            band = np.searchsorted(whitener.edges, frequency, side="right") - 1
            low = band < whitener.levels.shape[1]
            power[low] *= whitener.levels[o][band[low]]
        white = (lines[:, k] / np.sqrt(power + own))[1:]
        parts += [white.real, white.imag]
    return np.concatenate(parts)
