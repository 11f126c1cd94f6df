"""What a law would do to first order: its torques along a motion that is known, through the linear plant."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.second.campaign import Campaign
from analysis.challenge.second.integrate import Motion, Placed, split_delay
from sim_backend.jit import njit

Array = NDArray[np.float64]

_SUBSTEPS = 6


def first_order(one: Placed, campaign: Campaign, motion: Motion, index: int) -> Array:
    """Return the change (n, axes) of the readings of a run by a law that acts along the run's `motion`."""
    how = one.law.how
    if how == "record":
        rng = np.random.default_rng([campaign.chance, index])
        change = np.zeros_like(motion.reading)
        reading = motion.reading[:, one.i]
        change[:, one.i] = one.law.function(reading, motion.v[:, one.i], one.p, campaign.rate_hz, rng) - reading
        return change
    if how == "delay":
        later = replace(campaign.plant, delay_s=campaign.plant.delay_s + float(one.p[0]))
        own = np.where(np.arange(campaign.plant.axes) == one.i, motion.command, 0.0)
        return campaign.answer(own, later) - campaign.answer(own)
    out = np.zeros_like(motion.y)
    rest = (np.zeros(one.law.states), one.p, one.i, one.j, campaign.rate_hz, out)
    code, late = one.law.function.made, _late(campaign)
    command = np.vstack([np.zeros((late, out.shape[1])), motion.command])[: out.shape[0]]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "First-class function type", Warning)
        if how == "reading":
            _read(code, motion.y, motion.v, command, *rest)
            return out
        if one.law.site == "drive":  # its torque is held as the command is, and comes as late
            y, v = (np.vstack([x[late:], np.repeat(x[-1:], late, axis=0)]) for x in (motion.y, motion.v))
            _push(code, y, v, motion.command, *rest)
            return campaign.answer(out)
        _push(code, motion.y, motion.v, command, *rest)
    held = 0.5 * (out + np.vstack([out[1:], out[-1:]]))
    return campaign.answer(held, replace(campaign.plant, delay_s=0.0))


def _late(campaign: Campaign) -> int:
    """Return the delay of commands in whole samples, rounded."""
    whole, part = split_delay(campaign.plant.delay_s, campaign.rate_hz)
    return whole + (1 if part > 0.5 else 0)


@njit
def _read(law, y, v, u, x, p, i, j, rate_hz, out):
    r = np.zeros(y.shape[1])
    for k in range(y.shape[0]):
        r[:] = y[k]
        law(k / rate_hz, y[k], v[k], u[k], x, p, r, i, j)
        out[k] = r - y[k]


@njit
def _push(law, y, v, u, z, p, i, j, rate_hz, out):
    n, axes = y.shape
    h = 1.0 / (rate_hz * _SUBSTEPS)
    here, rate, f, first, second = np.zeros(axes), np.zeros(axes), np.zeros(axes), np.zeros(z.size), np.zeros(z.size)
    for k in range(n):
        f[:] = 0.0
        law(k / rate_hz, y[k], v[k], u[k], z, first, p, f, i, j)
        out[k] = f
        if z.size == 0 or k == n - 1:
            continue
        for s in range(_SUBSTEPS):
            w = (s + 0.5) / _SUBSTEPS
            for a in range(axes):
                here[a] = (1.0 - w) * y[k, a] + w * y[k + 1, a]
                rate[a] = (1.0 - w) * v[k, a] + w * v[k + 1, a]
            t = k / rate_hz + w / rate_hz
            law(t, here, rate, u[k], z, first, p, f, i, j)
            law(t, here, rate, u[k], z + 0.5 * h * first, second, p, f, i, j)
            z += h * second
