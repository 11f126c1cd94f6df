"""Response of several experiments at every frequency by instrumental variables, in one compiled pass over the spectra.

At each frequency G = (Y W')(U W')^-1 over the experiments, with the instrument W = U in open loop. With residual
V = Y - G U, E|error of G[y, u]|² = E|V[y]|² · S[u, u], where S = (U W')^-1 (W W') (U W')^-H, if the experiments'
errors are independent. Distortion of orthogonal multisines is not independent within a block of n_u experiments, so
blocks are also solved one by one.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from sim_backend.jit import njit

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


_CHUNK = 256
"""Lines taken together: long enough for the inner loops over them, short enough for the processor's cache."""

_FIRST = np.intp(0)
"""The first column: for a plain 0, which is a type of its own, two kernels would be compiled a second time."""


@njit
def _gather(data: ComplexArray, at: NDArray[np.intp], parts: Array, mean: Array) -> None:
    """Fetch lines `at` of (channel, experiment, period, line) into (…, 2, line), and their `mean` over the periods.

    With real and imaginary parts apart, the compiler takes several lines at once in all that follows.
    """
    n_c, n_e, n_p = data.shape[:3]
    together = at[-1] - at[0] == at.size - 1
    for c in range(n_c):
        for e in range(n_e):
            total = mean[c, e]
            total[:] = 0.0
            for p in range(n_p):
                row, part = data[c, e, p], parts[c, e, p]
                if together:
                    row = row[at[0] : at[0] + at.size]
                    for k in range(at.size):
                        part[0, k], part[1, k] = row[k].real, row[k].imag
                else:
                    for k in range(at.size):
                        part[0, k], part[1, k] = row[at[k]].real, row[at[k]].imag
                for k in range(at.size):
                    total[0, k] += part[0, k]
                    total[1, k] += part[1, k]
            for k in range(at.size):
                total[0, k] *= 1.0 / n_p
                total[1, k] *= 1.0 / n_p


@njit
def _products(a: Array, b: Array, out: Array) -> None:
    """Fill `out` (n_a, n_b, 2, line) with A B' over the experiments, of averages (channel, experiment, 2, line)."""
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            total = out[i, j]
            total[:] = 0.0
            for e in range(a.shape[1]):
                x, y = a[i, e], b[j, e]
                for k in range(x.shape[1]):
                    total[0, k] += x[0, k] * y[0, k] + x[1, k] * y[1, k]
                    total[1, k] += x[1, k] * y[0, k] - x[0, k] * y[1, k]


@njit
def _times(a: Array, first: int, b: Array, out: Array) -> None:
    """Fill `out` (n, m, 2, line) with A B at every line, of B (q, m, 2, line) and A's q columns from `first` on."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            total = out[i, j]
            total[:] = 0.0
            for m in range(b.shape[0]):
                x, y = a[i, first + m], b[m, j]
                for k in range(x.shape[1]):
                    total[0, k] += x[0, k] * y[0, k] - x[1, k] * y[1, k]
                    total[1, k] += x[0, k] * y[1, k] + x[1, k] * y[0, k]


@njit
def _power(values: Array, out: Array) -> None:
    """Fill `out` (line,) with the squared magnitude of `values` (2, line)."""
    for k in range(out.size):
        out[k] = values[0, k] * values[0, k] + values[1, k] * values[1, k]


@njit
def _exchange(a: Array, b: Array, swap: NDArray[np.bool_]) -> None:
    """Exchange `a` and `b` (2, line) at the lines where `swap` says so."""
    for part in range(2):
        x, y = a[part], b[part]
        for k in range(swap.size):
            x[k], y[k] = (y[k], x[k]) if swap[k] else (x[k], y[k])


@njit(error_model="numpy")
def _inverses(matrix: Array, first: int, inverse: Array, good: NDArray[np.bool_]) -> None:
    """Fill `inverse` (n, n, 2, line) with that of `matrix`, of whose columns n from `first` on are taken.

    Gauss-Jordan with row pivots, all lines at once; the flag is lowered where a pivot is nothing beside the largest
    entry.
    """
    n, n_l = matrix.shape[0], good.size
    work = matrix[:, first : first + n].copy()
    factor, size, other, largest = np.empty((2, n_l)), np.empty(n_l), np.empty(n_l), np.zeros(n_l)
    inverse[:] = 0.0
    for i in range(n):
        inverse[i, i, 0] = 1.0
        for j in range(n):
            _power(work[i, j], other)
            for k in range(n_l):
                largest[k] = max(largest[k], other[k])
    for c in range(n):
        _power(work[c, c], size)
        for i in range(c + 1, n):
            _power(work[i, c], other)
            swap = other > size
            for j in range(n):
                _exchange(work[c, j], work[i, j], swap)
                _exchange(inverse[c, j], inverse[i, j], swap)
            for k in range(n_l):
                size[k] = max(size[k], other[k])
        pivot = work[c, c]
        for k in range(n_l):
            good[k] &= size[k] > 1e-26 * largest[k]  # 1e-13 of the largest entry
            factor[0, k], factor[1, k] = pivot[0, k] / size[k], -pivot[1, k] / size[k]
        for j in range(n):
            _scale(work[c, j], factor)
            _scale(inverse[c, j], factor)
        for i in range(n):
            if i != c:
                for k in range(n_l):  # one by one: see `analysis.linear.simulate._add_direct`
                    factor[0, k], factor[1, k] = work[i, c, 0, k], work[i, c, 1, k]
                for j in range(n):
                    _subtract(factor, work[c, j], work[i, j])
                    _subtract(factor, inverse[c, j], inverse[i, j])


@njit
def _scale(values: Array, factor: Array) -> None:
    """Multiply `values` by `factor`, both (2, line)."""
    for k in range(values.shape[1]):
        re, im = values[0, k], values[1, k]
        values[0, k], values[1, k] = re * factor[0, k] - im * factor[1, k], re * factor[1, k] + im * factor[0, k]


@njit
def _weights(w: Array, inverse: Array, size: Array) -> None:
    """Fill `size` (n_u, line) with the diagonal of S: row e of W' (U W')^-1 weighs experiment e in each column of G."""
    weight = np.empty((2, size.shape[1]))
    for j in range(inverse.shape[1]):
        size[j] = 0.0
        for e in range(w.shape[1]):
            weight[:] = 0.0
            for m in range(w.shape[0]):
                x, y = w[m, e], inverse[m, j]
                for k in range(x.shape[1]):
                    weight[0, k] += x[0, k] * y[0, k] + x[1, k] * y[1, k]
                    weight[1, k] += x[0, k] * y[1, k] - x[1, k] * y[0, k]
            for k in range(weight.shape[1]):
                size[j, k] += weight[0, k] * weight[0, k] + weight[1, k] * weight[1, k]


@njit
def _add_spread(u: Array, y: Array, g: Array, inverse: Array, spread: Array, good: NDArray[np.bool_]) -> None:
    """Add |Y U^-1 - G|² of each block of n_u experiments to `spread` (n_y, n_u, line).

    As many experiments as inputs need no instrument: W drops out of (Y W')(U W')^-1.
    """
    n_u = u.shape[0]
    single = np.empty_like(g)
    for block in range(u.shape[1] // n_u):
        _inverses(u, block * n_u, inverse, good)
        _times(y, block * n_u, inverse, single)
        for i in range(g.shape[0]):
            for j in range(n_u):
                x, z = single[i, j], g[i, j]
                for k in range(x.shape[1]):
                    re, im = x[0, k] - z[0, k], x[1, k] - z[1, k]
                    spread[i, j, k] += re * re + im * im


@njit
def _squares(u: Array, y: Array, um: Array, ym: Array, g: Array, sums: Array) -> None:
    """Fill `sums` (3, n_y, line): scatter over the periods, misfit of the averages and power of the averaged output."""
    n_y, n_u = g.shape[:2]
    n_e, n_p, n_l = u.shape[1], u.shape[2], u.shape[4]
    mean, away = np.empty((n_y, 2, n_l)), np.empty((2, n_l))
    sums[:] = 0.0
    for e in range(n_e):
        for i in range(n_y):
            out, middle = ym[i, e], mean[i]
            for k in range(n_l):
                sums[2, i, k] += out[0, k] * out[0, k] + out[1, k] * out[1, k]
                middle[0, k], middle[1, k] = out[0, k], out[1, k]
            for j in range(n_u):
                _subtract(g[i, j], um[j, e], middle)
            for k in range(n_l):
                sums[1, i, k] += middle[0, k] * middle[0, k] + middle[1, k] * middle[1, k]
        for p in range(n_p):
            for i in range(n_y):
                out, middle, scatter = y[i, e, p], mean[i], sums[0, i]
                for k in range(n_l):
                    away[0, k], away[1, k] = out[0, k] - middle[0, k], out[1, k] - middle[1, k]
                for j in range(n_u):
                    _subtract(g[i, j], u[j, e, p], away)
                for k in range(n_l):
                    scatter[k] += away[0, k] * away[0, k] + away[1, k] * away[1, k]


@njit
def _subtract(gain: Array, drive: Array, away: Array) -> None:
    """Take gain times drive off `away`, all (2, line)."""
    for k in range(away.shape[1]):
        away[0, k] -= gain[0, k] * drive[0, k] - gain[1, k] * drive[1, k]
        away[1, k] -= gain[0, k] * drive[1, k] + gain[1, k] * drive[0, k]


@njit(inline="always")
def _solve_chunk(
    u: ComplexArray,
    y: ComplexArray,
    w: ComplexArray,
    at: NDArray[np.intp],
    own: bool,
    blocked: bool,
    us: Array,
    ys: Array,
) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
    """Return what `solve_lines` returns for lines `at`, the lines last; `us` and `ys` are scratch memory.

    Inlined before it is translated: as a kernel of its own it would be optimised twice, for 2 s.
    """
    n_u, n_e, n_y, n_l = u.shape[0], u.shape[1], y.shape[0], at.size
    um, ym = np.empty((n_u, n_e, 2, n_l)), np.empty((n_y, n_e, 2, n_l))
    uw, inverse = np.empty((n_u, n_u, 2, n_l)), np.empty((n_u, n_u, 2, n_l))
    yw, g = np.empty((n_y, n_u, 2, n_l)), np.empty((n_y, n_u, 2, n_l))
    size, sums, spread = np.empty((n_u, n_l)), np.empty((3, n_y, n_l)), np.zeros((n_y, n_u, n_l))
    good = np.ones(n_l, dtype=np.bool_)
    wm = um
    if not own:
        wm = np.empty_like(um)
        _gather(w, at, us, wm)
    _gather(u, at, us, um)
    _gather(y, at, ys, ym)
    _products(um, wm, uw)
    _products(ym, wm, yw)
    _inverses(uw, _FIRST, inverse, good)
    _times(yw, _FIRST, inverse, g)
    _weights(wm, inverse, size)
    _squares(us, ys, um, ym, g, sums)
    if blocked:
        _add_spread(um, ym, g, inverse, spread, good)
    return g, size, sums, spread, good


def solve_lines(
    u: ComplexArray, y: ComplexArray, w: ComplexArray, lines: NDArray[np.intp], own: bool, blocked: bool, workers: int
) -> tuple[ComplexArray, Array, Array, Array, NDArray[np.bool_]]:
    """Return response, gain and sums of squares at each of `lines`, with so many threads.

    Shapes: `u`, `w` (n_u, experiments, periods, n_f), `y` (n_y, …); `own` says that `w` is `u`. Returns G (n_l, n_y,
    n_u), the diagonal of S (n_l, n_u), sums of squares (3, n_l, n_y) over periods about their mean, of the misfit of
    the averages and of the averaged output, that of the responses of single blocks of n_u experiments about G (n_l,
    n_y, n_u; zero unless `blocked`), and a flag (n_l,) that is False where the inputs cannot be separated.
    """
    n_l, n_u, n_y = lines.size, u.shape[0], y.shape[0]
    # here and not in compiled code: numpy asks the system for large pages, of which far fewer have to be fetched
    response, gain = np.empty((n_l, n_y, n_u), dtype=np.complex128), np.empty((n_l, n_u))
    squares, spreads, flag = np.empty((3, n_l, n_y)), np.empty((n_l, n_y, n_u)), np.empty(n_l, dtype=np.bool_)
    parts = min(workers, -(-n_l // _CHUNK))
    us, ys = (np.empty((parts, *x.shape[:3], 2, _CHUNK)) for x in (u, y))
    ends = np.linspace(0, n_l, parts + 1).astype(np.intp)

    def solve(part: int) -> None:
        memory, out = (us[part], ys[part]), (response, gain, squares, spreads, flag)
        _solve(u, y, w, lines, ends[part], ends[part + 1], own, blocked, memory, out)

    if parts == 1:
        solve(0)
    elif parts > 1:
        # threads of ours: numba takes 12 s to compile a loop for its own
        with ThreadPoolExecutor(parts) as pool:
            list(pool.map(solve, range(parts)))
    return response, gain, squares, spreads, flag


@njit
def _solve(
    u: ComplexArray,
    y: ComplexArray,
    w: ComplexArray,
    lines: NDArray[np.intp],
    start: int,
    stop: int,
    own: bool,
    blocked: bool,
    memory: tuple[Array, Array],
    out: tuple[ComplexArray, Array, Array, Array, NDArray[np.bool_]],
) -> None:
    """Fill what `solve_lines` returns from line `start` to `stop`; `memory` (…, 2, line) is for u and y to work in."""
    n_u, n_y = u.shape[0], y.shape[0]
    response, gain, squares, spreads, flag = out
    for first in range(start, stop, _CHUNK):
        at = lines[first : min(first + _CHUNK, stop)]
        some_u, some_y = memory
        if at.size < _CHUNK:  # whole arrays, since a part of one has gaps, with which no loop is vectorised
            some_u, some_y = np.empty((*u.shape[:3], 2, at.size)), np.empty((*y.shape[:3], 2, at.size))
        g, size, sums, spread, good = _solve_chunk(u, y, w, at, own, blocked, some_u, some_y)
        for k in range(at.size):
            flag[first + k] = good[k]
            for i in range(n_y):
                for j in range(n_u):
                    response[first + k, i, j] = complex(g[i, j, 0, k], g[i, j, 1, k])
                    spreads[first + k, i, j] = spread[i, j, k]
                for m in range(3):
                    squares[m, first + k, i] = sums[m, i, k]
            for j in range(n_u):
                gain[first + k, j] = size[j, k]
