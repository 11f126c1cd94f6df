"""Averaged cross spectra of long records, added up block by block: memory does not grow with the record."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy

from analysis.frequency.cross_spectra import ComplexArray
from analysis.frequency.frf import FrequencyResponse
from sim_backend.errors import DataError
from sim_backend.linear import Array

OVERLAP_VARIANCE = 1.0 + 2.0 / 36.0
"""Neighbouring Hann pieces that half overlap are correlated by 1/6: their mean varies that much more than of others."""

SEPARABLE = 1e8
"""Largest condition of the inputs' normalised spectra at which double precision can still distinguish them."""


@dataclass(frozen=True)
class AveragedSpectra:
    """Sums over `count` pieces of `piece` samples: `total` (n_f, c, c) of x x' at all lines of `rfft`, c channels."""

    piece: int
    count: int
    total: ComplexArray

    def response(self, rate_hz: float, n_u: int, n_y: int, floor: float = 0.0) -> FrequencyResponse:
        """Return the response from the first `n_u` channels to the `n_y` after them, with the last `n_u` as instrument.

        Without channels after those, the inputs are their own instrument (H1). Lines at which an instrument has less
        than `floor` times the power of its strongest line are left out. Noise and distortion cannot be separated:
        both variances are the total. Raises DataError when there are too few pieces, or the inputs do not move
        independently.
        """
        if self.count < n_u + 2:
            raise DataError(f"{self.count} pieces of {self.piece} samples; {n_u} inputs need {n_u + 2}: record longer")
        u, y = slice(0, n_u), slice(n_u, n_u + n_y)
        w = u if self.total.shape[1] == n_u + n_y else slice(self.total.shape[1] - n_u, None)
        power = np.einsum("fcc->fc", self.total).real[: self.piece // 2]
        power[:2] = 0.0  # the mean's leakage fills the first two lines
        lines = np.flatnonzero(np.all(power[:, w] > floor * power[:, w].max(axis=0), axis=1))
        s, size = self.total[lines], np.sqrt(power[lines])
        joint = s[:, u, w] / (size[:, u, None] * size[:, None, w])
        _require_independent(joint, lines * rate_hz / self.piece)
        inverse = np.linalg.inv(s[:, u, w])
        g = s[:, y, w] @ inverse
        mix = np.concatenate([-g, np.broadcast_to(np.eye(n_y), (lines.size, n_y, n_y))], axis=2)
        both = slice(0, n_u + n_y)
        misfit = np.einsum("fyz,fzx,fyx->fy", mix, s[:, both, both], mix.conj()).real
        gain = np.einsum("flj,flk,fkj->fj", inverse.conj(), s[:, w, w], inverse).real
        dof = self.count - n_u
        noise = np.maximum(misfit, 0.0) / dof
        variance = noise[:, :, None] * gain[:, None, :] * OVERLAP_VARIANCE
        unknown = np.full(noise.shape, np.nan)
        return FrequencyResponse(
            lines * rate_hz / self.piece,
            g,
            variance,
            variance,
            2.0 * noise,
            unknown,
            2.0 * power[lines, y] / self.count,
            dof,
            dof,
        )


def _require_independent(joint: ComplexArray, frequency_hz: Array) -> None:
    """Raise DataError where the inputs cannot be separated by their normalised spectra (n_f, n_u, n_u)."""
    if frequency_hz.size == 0:
        raise DataError("there is no frequency at which every input moves; excite all inputs in one band")
    still = np.flatnonzero(~np.isfinite(joint).all(axis=(1, 2)))
    if still.size:
        raise DataError(
            f"an input does not move at {frequency_hz[still[0]]:.4g} Hz; excite all inputs at every frequency in use"
        )
    condition = np.linalg.cond(joint)
    worst = int(np.argmax(condition))
    if condition[worst] > SEPARABLE:
        raise DataError(
            f"the inputs do not move independently at {frequency_hz[worst]:.4g} Hz: the condition of their spectra is "
            f"{condition[worst]:.3g} there, the limit is {SEPARABLE:g}; excite them one after the other, or by "
            "independent signals"
        )


def averaged_spectra(records: Iterable[Iterable[Array]], piece: int, channels: int, offset: Array) -> AveragedSpectra:
    """Return the spectra of records, each of them consecutive blocks (n, channels), from half-overlapping Hann pieces.

    `offset` (channels,) is taken off first: a constant does not matter, but a large one would cost digits.
    """
    window = scipy.signal.windows.hann(piece, sym=False)[:, None] / np.sqrt(3.0 / 8.0)
    hop, count = piece // 2, 0
    total = np.zeros((piece // 2 + 1, channels, channels), dtype=np.complex128)
    for blocks in records:
        rows = np.empty((0, channels))
        for block in blocks:
            rows = np.concatenate([rows, block - offset])
            pieces = max((rows.shape[0] - piece) // hop + 1, 0)
            for start in range(0, pieces * hop, hop):
                x = scipy.fft.rfft(rows[start : start + piece] * window, axis=0, norm="forward")
                total += x[:, :, None] * x[:, None, :].conj()
            rows, count = rows[pieces * hop :], count + pieces
    return AveragedSpectra(piece, count, total)
