"""A record of another bench than the model's: refused before any fit, as no cause in the library is a factor of ten.

Compared are the measured motion and that which the linear model simulates from the recorded inputs, by thirds of an
octave, where the two agree in shape (coherence). A resonance that is a few per cent off differs beside itself alone; a
model of another bench, a wrong unit or a wrong channel differs nearly everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.records.loading import Loaded
from sim_backend.errors import DataError
from sim_backend.linear import discretise
from sim_backend.model import Model

Array = NDArray[np.float64]

FACTOR = 10.0
"""Ratio of measured to simulated motion, either way, for half of the motion; no listed effect is so large."""

_COHERENT = 0.5
"""Bands in which less of the measured motion follows the simulated one say nothing of its size."""

_MOVES = 0.01
"""Part of the energy of the strongest band from which on the output moves in another."""

_SHOWN = 0.5
"""Part of the energy of the motion below which the bands say nothing of it: slower ones have too few lines."""

_LINES = 16
"""Fewest lines of a band: a coherence of fewer is high by chance."""

_BANDS = 3
"""Fewest bands that a verdict rests on."""

_THIRD = 2.0 ** (1.0 / 3.0)


def check_same_bench(loaded: Loaded, model: Model) -> None:
    """Raise DataError for the first record with an output that the model does not describe at all."""
    plant = discretise(model.linear(), loaded.data.rate_hz)
    files = {source.run_uid: source.file for source in loaded.sources}
    for record in loaded.data.records:
        file, simulated = files[record.name], simulate(plant, record.u)
        for o, name in enumerate(port.name for port in model.outputs):
            bands = np.array(list(_ratios(simulated[:, o], record.y[:, o])))
            if len(bands) < _BANDS:
                continue
            middle = _middle(*bands.T)
            if max(middle, 1.0 / middle) > FACTOR:
                raise DataError(
                    f"{file}: output '{name}' moves {middle:.3g} times as much as the model says, where half of its "
                    f"motion is; causes are looked for up to a factor of {FACTOR:g}. Is it a record of another "
                    "bench, or is a unit or a channel wrong? `mccd log plot` shows it, `mccd identify` models it"
                )


def _bands(lines: int) -> Iterator[slice]:
    """Yield the lines of every third of an octave, `_LINES` or more of them."""
    edge = float(_LINES)
    while edge < lines - 1:
        stop = max(edge * _THIRD, edge + _LINES)
        yield slice(int(edge), min(int(stop), lines))
        edge = stop


def _middle(ratios: Array, energy: Array) -> float:
    """Return the ratio on either side of which half of the energy of the motion lies.

    In a loop the input answers the noise, and a simulation agrees with it in shape at any size: in most bands perhaps,
    but not in those of the motion.
    """
    order = np.argsort(ratios)
    below = np.cumsum(energy[order])
    return float(ratios[order][int(np.searchsorted(below, 0.5 * below[-1]))])


def _ratios(simulated: Array, measured: Array) -> Iterator[tuple[float, float]]:
    """Yield, for each band in which both agree in shape, how much more is measured than simulated, and its energy.

    Nothing where most of the motion is too slow for bands. Both are differenced twice, so that an offset or a drift of
    a free axis does not leak into every band. Only where the output moves is it asked: in a loop the input answers the
    noise, and so agrees with it everywhere else.
    """
    a, b = (np.fft.rfft(np.diff(x, n=2) * np.hanning(x.size - 2)) for x in (simulated, measured))
    moved = np.abs(np.fft.rfft(scipy.signal.detrend(measured)[1:-1] * np.hanning(measured.size - 2))) ** 2
    bands = list(_bands(a.size))
    energy = np.array([np.sum(moved[band]) for band in bands])
    if energy.sum() < _SHOWN * moved.sum():
        return
    for band, own_energy in zip(bands, energy, strict=True):
        if own_energy < _MOVES * energy.max():
            continue
        own, other = float(np.sum(np.abs(a[band]) ** 2)), float(np.sum(np.abs(b[band]) ** 2))
        cross = abs(complex(np.vdot(a[band], b[band])))
        if own > 0.0 and other > 0.0 and cross**2 > _COHERENT * own * other:
            yield cross / own, own_energy
