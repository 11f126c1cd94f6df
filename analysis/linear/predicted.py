"""The frequency response of a model with linear effects in it, exactly: no loop is played.

An effect of the linear model adjusts it. Any other adds a signal by its compiled step; one that is linear is a state
space (A, B, C, D) in the state and what the step receives, whose columns are the answers to unit vectors. Its transfer
function C (zI - A)⁻¹ B + D is taken at steps so short that nothing happens within one, so that it is the continuous
effect's, and closed around the plant at the effect's location.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sim_backend.assembly import Places, retuned
from sim_backend.effects.base import Aux, Effect, Site
from sim_backend.linear import Array, ComplexArray, ModalModel

_PLACES = (Site.MODEL, Site.COMMAND, Site.STRUCTURE, Site.READING)
_AUXILIARY = (Aux.NONE, Aux.SOURCE_COMMAND, Aux.SOURCE_POSITION)

_STEPS = 1e4
"""Steps per second and Hz of the highest line: half a step, by which a held signal is late, is then 3e-4 rad there."""


def changes_the_response(effect: type[Effect]) -> bool:
    """Tell whether an effect is linear and acts where its response is known in closed form."""
    return effect.linear_form and effect.site in _PLACES and effect.aux in _AUXILIARY


_MOST_KEPT = 8

_Transfer = tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]


@dataclass(frozen=True)
class Predictor:
    """What a model with effects answers at some frequencies (n,), and where its effects can be.

    With `hold_rate_hz` the model is one of samples behind a hold, without it is continuous.
    """

    places: Places
    frequency_hz: Array
    hold_rate_hz: float | None = None
    _kept: dict[Effect, _Transfer] = field(init=False, default_factory=dict, repr=False, compare=False)

    def response(self, linear: ModalModel, effects: Sequence[Effect] = ()) -> ComplexArray:
        """Return the response (n, n_y, n_u), delays included."""
        changed = retuned(linear, effects, self.places)
        out = self._with_structure(changed, [e for e in effects if e.site is Site.STRUCTURE])
        for effect in effects:
            if effect.site is Site.COMMAND:
                out = out @ self._mixing(effect, len(self.places.inputs), self.places.inputs)
            elif effect.site is Site.READING:
                out = self._mixing(effect, len(self.places.outputs), self.places.outputs) @ out
        return out

    def _with_structure(self, linear: ModalModel, effects: Sequence[Effect]) -> ComplexArray:
        """Return the response with the forces that `effects` add where the structure moves.

        With P from inputs to outputs and G from outputs to forces, y = P (u + G y) = (I - P G)⁻¹ P u. Commands alone
        pass the delay, and it commutes with what comes after it.
        """
        plain = linear.frequency_response(self.frequency_hz, self.hold_rate_hz)
        if not effects:
            return plain
        undelayed = linear.with_(delay_s=np.zeros(linear.n_inputs)).frequency_response(self.frequency_hz)
        forces = np.zeros((self.frequency_hz.size, linear.n_inputs, linear.n_outputs), dtype=complex)
        s = 2j * np.pi * self.frequency_hz
        for effect in effects:
            j = self.places.inputs.index(effect.where)
            _, position, rate, _ = self._transfer(effect)
            forces[:, j, :] += (position + s * rate)[:, None] * self.places.coordinates[j]
        closed = np.eye(linear.n_outputs) - undelayed @ forces
        return np.asarray(np.linalg.solve(closed, plain), dtype=np.complex128)

    def _mixing(self, effect: Effect, n: int, names: tuple[str, ...]) -> ComplexArray:
        """Return what an effect makes of the commands or readings of all axes, (n_f, n, n)."""
        signal, _, _, aux = self._transfer(effect)
        source, _, target = effect.where.rpartition("->")
        at = names.index(target)
        out = np.broadcast_to(np.eye(n), (self.frequency_hz.size, n, n)).astype(complex)
        out[:, at, at] += signal
        if source:
            out[:, at, names.index(source)] += aux
        return out

    def _transfer(self, effect: Effect) -> _Transfer:
        """Return what an effect adds, kept while only numbers of the model change."""
        if effect not in self._kept:
            if len(self._kept) > _MOST_KEPT:
                self._kept.clear()
            self._kept[effect] = self._transferred(effect)
        return self._kept[effect]

    def _transferred(self, effect: Effect) -> _Transfer:
        """Return what an effect adds per unit of signal, position, rate and auxiliary signal, each (n_f,)."""
        dt_s = 1.0 / (_STEPS * float(self.frequency_hz.max()))
        p, n = effect.values(), effect.n_state
        a, b, c, d = np.zeros((n, n)), np.zeros((n, 4)), np.zeros(n), np.zeros(4)
        for k in range(n + 4):
            state, received = np.zeros(n), np.zeros(4)
            (state if k < n else received)[k if k < n else k - n] = 1.0
            added = effect.step.__wrapped__(*received, dt_s, p, state)
            if k < n:
                a[:, k], c[k] = state, added
            else:
                b[:, k - n], d[k - n] = state, added
        if not n:
            return tuple(np.full(self.frequency_hz.size, x, dtype=complex) for x in d)  # type: ignore[return-value]
        z = np.exp(2j * np.pi * self.frequency_hz * dt_s)
        states = np.linalg.solve(z[:, None, None] * np.eye(n) - a, np.broadcast_to(b, (z.size, n, 4)).astype(complex))
        found = np.einsum("k,fkw->fw", c, states) + d
        return found[:, 0], found[:, 1], found[:, 2], found[:, 3]
