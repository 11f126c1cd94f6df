"""What an input does between its samples: the steps that represent a smooth signal.

Between two samples the bench's own converter holds its value, and so does every simulation here. A recorder behind an
anti-alias filter sees a smooth input instead; playing its samples as steps would delay them by half a sample and weaken
them by sinc(f / rate). `steps_for` takes both back: held, its result has the recorded signal's spectrum up to half the
rate. The remaining error is the images above, which a plant that falls off like 1/s² attenuates.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

_EDGE = 256
"""Samples reflected at each end of a record that does not repeat: the inverse of a hold extends over a few samples."""


def steps_for(u: Array, *, period: int = 0) -> Array:
    """Return the held values (n, n_u) that represent the band-limited signal of which `u` (n, n_u) are the samples.

    A record of whole periods of `period` samples is taken as going on before and after. The value at half the rate,
    whose phase the samples do not determine, is left out.
    """
    n = u.shape[0]
    repeats = period > 0 and n % period == 0
    pad = 0 if repeats else min(_EDGE, n - 1)
    # odd reflection keeps value and slope at the ends
    longer = np.concatenate([2.0 * u[:1] - u[pad:0:-1], u, 2.0 * u[-1:] - u[-2 : -pad - 2 : -1]]) if pad else u
    rows = longer.shape[0]
    spectrum = scipy.fft.rfft(longer, axis=0) / hold_response(np.arange(rows // 2 + 1) / rows)[:, None]
    if rows % 2 == 0:
        spectrum[-1] = 0.0
    return np.ascontiguousarray(scipy.fft.irfft(spectrum, rows, axis=0)[pad : pad + n])


def hold_response(cycles_per_sample: Array) -> NDArray[np.complex128]:
    """Return the zero-order hold's response, sinc(f) exp(-jπf), of the shape of its argument."""
    f = np.asarray(cycles_per_sample, dtype=float)
    return np.asarray(np.sinc(f) * np.exp(-1j * np.pi * f))
