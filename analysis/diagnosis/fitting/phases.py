"""The phase of a free-running disturbance in an unseen record: a vibration is not synchronised with the run.

Like the state in which such a record begins, the phase is fitted to the record itself. Its size and its frequency stay
those of the fit, so that a vibration that is not there still makes the record worse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from analysis.diagnosis.noise.whitener import Mask
from campaigns.facts.base import stretches_of
from sim_backend.effects.base import Effect
from sim_backend.linear import Array


def in_phase(
    effects: Sequence[Effect],
    left: Callable[[Sequence[Effect]], Array],
    added: Callable[[Effect], Array],
    weight: Array,
    rate_hz: float,
) -> list[Effect]:
    """Return `effects` with the free-running ones in the phase in which a record shows them.

    `left` is the record without the other effects, `added` what one adds in the phase that it has, (n, n_y) both;
    samples and outputs count by their `weight` (n, n_y). Hann windows suppress what a start adds, what is slow, and
    other vibration lines that are at least two frequency bins of a stretch away.
    """
    steady = [e for e in effects if not e.own_frequency_hz()]
    if len(steady) == len(effects):
        return list(effects)
    rest = left(steady)
    rows = np.arange(weight.shape[0])
    window = _hann_of_each(np.any(weight > 0.0, axis=1))[:, None] * weight**2

    def turned(effect: Effect) -> Effect:
        turning = np.exp(-2j * np.pi * effect.own_frequency_hz() / rate_hz * rows)
        seen, there = (turning @ (window * values) for values in (rest, added(effect)))
        return effect.turned(float(np.angle(np.vdot(there, seen))) / (2.0 * np.pi))

    return [turned(e) if e.own_frequency_hz() else e for e in effects]


def _hann_of_each(used: Mask) -> Array:
    """Return a Hann window (n,) over each stretch of samples that are `used` (n,)."""
    window = np.zeros(used.size)
    for first, last in stretches_of(used):
        window[first:last] = np.hanning(last - first)
    return window
