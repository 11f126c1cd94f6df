"""A bench of one mode and settings about given residuals, for tests of what is seen in the residual alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from sim_backend.assembly import places_of, transducers_of
from sim_backend.model import Mode, Model, Port

Array = NDArray[np.float64]

RATE_HZ = 1000.0
RESONANCE_HZ, DECAY_1_S = 20.0, 12.0
_OMEGA = 2.0 * np.pi * RESONANCE_HZ

MODEL = Model(
    name="oscillator",
    sample_rate_hz=RATE_HZ,
    inputs=[Port(name="force", unit="N", dof="x")],
    outputs=[Port(name="x", unit="m", dof="x")],
    modes=[
        Mode(
            label="only",
            frequency_hz=RESONANCE_HZ,
            decay_rate_1_s=DECAY_1_S,
            input={"force": _OMEGA**2},
            output={"x": 1.0},
        )
    ],
)


def moved(force: Array) -> Array:
    """Return the oscillator's displacement under a held `force` (n,), by scipy's own discretisation."""
    top, bottom, _ = cont2discrete(([_OMEGA**2], [1.0, 2.0 * DECAY_1_S, _OMEGA**2]), 1.0 / RATE_HZ)
    return np.asarray(lfilter(top.ravel(), bottom, force))


LADDER = np.exp(-2.0 * np.pi * np.array([[0.2, 0.7], [1.5, 5.0]]) / RATE_HZ)
"""Poles and zeros of noise that is white above 5 Hz and rises as flicker down to 0.2 Hz."""


def flicker(rng: np.random.Generator, n: int) -> Array:
    """Return noise (n,) of that colour, of unit size where it is white."""
    settling = 20_000  # samples: 25 times the memory of the slowest pole
    white = rng.standard_normal(n + settling)
    for pole, zero in LADDER:
        white = lfilter([1.0, -zero], [1.0, -pole], white)
    return np.asarray(white[settling:])


def setting_of(force: Array, reading: Array, residual: Array, noise_std: float, period: int = 0) -> tuple[Setting, Fit]:
    """Return a setting of one record with white noise of known size, and the fit that leaves `residual` (n,)."""
    n = force.size
    record = Record("run", force[:, None], reading[:, None], (Window("all", 0, n, False, period),))
    whitener = Whitener(np.array([[1.0 / noise_std]]), bool(period))
    data = Dataset(RATE_HZ, (record,))
    setting = Setting(
        data,
        MODEL.linear(),
        (),
        places_of(MODEL),
        transducers_of(MODEL),
        [],
        whitener,
        starts_of(data, MODEL.linear(), whitener),
        (),
        1,
    )
    none = np.zeros(0)
    misfit = float(np.sum((residual / noise_std) ** 2))
    fit = Fit((), none, (), misfit, 0.0, n, 0.0, 0.0, (), none, none, (residual[:, None],), ())
    return setting, fit
