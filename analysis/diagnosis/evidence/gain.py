"""What an extended model gains on samples that no fit has seen: rms before and after against noise, with an interval.

The interval is a moving-block bootstrap (Künsch 1989): blocks of samples, longer than the residual's correlation time,
are resampled from every held-out window, with before and after always drawn together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import free_responses
from analysis.diagnosis.records.dataset import Dataset, Window
from analysis.diagnosis.result import SELDOM, Gain, OutputGain, SegmentGain
from analysis.diagnosis.tails import chi2_limit
from sim_backend.linear import Array, ModalModel, discretise

DRAWS = 2000

_BELOW = 32
"""Frequencies over which the noise below half a frequency bin of some samples is summed."""

LEAST_BLOCKS = 8
"""Blocks that a window should give at least; with fewer the interval would rest on too few draws."""

LEAST_ROWS = 8
"""Fewest readings per state of a window that starts in a new unknown state: with fewer, fitting the start would absorb
more than an eighth of the residual, and with it the effect of a wrong damping or stiffness in so short a time."""


def gain_of(
    data: Dataset,
    before: Sequence[Array],
    after: Sequence[Array],
    whitener: Whitener,
    first: ModalModel,
    extended: ModalModel,
    outputs: Sequence[str],
    seed: int = 0,
    errors: Mapping[int, Array] | None = None,
) -> Gain | None:
    """Return the gain on all held-out windows, and by the `outputs` of these names; None when nothing moves there.

    `before` and `after` are each record's residuals (n, n_y). All values are rms over samples and outputs, each output
    relative to its own rms about its mean on those samples. Outputs that are not simulated to move by more than their
    noise, as those of axes that nothing drives, are left out: all of them is error, whatever the model. What the state
    in which a window begins can add under `first` and `extended`, the linear models that left `before` and `after`, is
    taken out of it. `errors` are those of `tuning_errors`, none without.
    """
    windows = [(i, w) for i, w in data.windows if w.held_out]
    if not windows:
        return None
    # the free response of a start decays, and would be taken for noise that differs between periods; so would motion
    # that the model gets wrong after a change of the excitation, of which the better of both models leaves less
    left = _cleaned(data, before, first, windows), _cleaned(data, after, extended, windows)
    noise = np.minimum(*(_noise_rms(clean, data.n_outputs, whitener, windows) for clean in left))
    moved = np.maximum(_simulated_size(data, before, windows), _simulated_size(data, after, windows)) > noise
    size = np.where(moved | ~np.any(moved), _output_size(data, windows), np.inf)
    if not np.any(np.isfinite(size)):
        return None
    one, other = (_squares(clean, windows, size) for clean in left)
    rms_before, rms_after = _rms(one), _rms(other)
    counted = np.isfinite(size)
    names = tuple(f"{data.records[i].name}#{w.label}" for i, w in windows)
    own = [np.where(counted, _output_size(data, [one]), np.inf) for one in windows]
    each = [[_rms(_squares(clean, [w], mine)) for w, mine in zip(windows, own, strict=True)] for clean in left]
    # noise that is known from other samples may seem larger than the error that it is part of
    floor = min(float(np.sqrt(np.mean((noise[counted] / size[counted]) ** 2))), rms_before, rms_after)
    wrong = _cleaned(data, errors, extended, windows) if errors else {}
    white = [_in_noise(c, data, windows, whitener, counted) for c in (*left, wrong)]
    times, times_std = _times(*white)
    draws, least = _bootstrap(one, other, _block(data, first), np.random.default_rng(seed))
    return Gain(
        held_out=names,
        rms_before=rms_before,
        rms_after=rms_after,
        noise_floor=floor,
        reduction=1.0 - rms_after / rms_before if rms_before > 0.0 else 0.0,
        ci95=(float(np.quantile(draws, 0.025)), float(np.quantile(draws, 0.975))),
        segments=tuple(SegmentGain(*one) for one in zip(names, *each, strict=True)),
        outputs=_by_output(left, windows, noise, size, outputs),
        least_error=least,
        most_noise=_most_noise(noise, size, whitener, wrong, windows),
        times=times,
        times_std=times_std,
    )


def _by_output(
    left: tuple[Mapping[int, Array], Mapping[int, Array]],
    windows: Sequence[tuple[int, Window]],
    noise: Array,
    size: Array,
    names: Sequence[str],
) -> tuple[OutputGain, ...]:
    """Return the gain on each output that moves: residual before and after, and the noise, relative to its own size."""

    def alone(clean: Mapping[int, Array], o: int) -> float:
        return _rms(_squares(clean, windows, np.where(np.arange(size.size) == o, size, np.inf)))

    moving = np.flatnonzero(np.isfinite(size)).tolist()
    before, after = left
    found = []
    for o in moving:
        errors = alone(before, o), alone(after, o)
        # as in all outputs together: the noise is part of these errors
        found.append(OutputGain(names[o], *errors, min(float(noise[o] / size[o]), *errors)))
    return tuple(found)


def size_on_held_out(
    data: Dataset,
    before: Sequence[Array],
    after: Sequence[Array],
    whitener: Whitener,
    first: ModalModel,
    extended: ModalModel,
    errors: Array,
) -> tuple[float, float]:
    """Return the factor by which held-out samples would scale what was added, and the standard deviation of that.

    Arguments as of `gain_of`, `errors` (rows, k) by `errors_in_noise`; every output counts in units of its noise.
    """
    windows = [(i, w) for i, w in data.windows if w.held_out]
    left = _cleaned(data, before, first, windows), _cleaned(data, after, extended, windows)
    every = np.ones(data.n_outputs, dtype=bool)
    white = [_in_noise(clean, data, windows, whitener, every) for clean in left]
    return _times(white[0], white[1], errors)


def errors_in_noise(data: Dataset, errors: Mapping[int, Array], whitener: Whitener, extended: ModalModel) -> Array:
    """Return the `errors` of `tuning_errors` on held-out samples as `size_on_held_out` compares them, (rows, k)."""
    windows = [(i, w) for i, w in data.windows if w.held_out]
    wrong = _cleaned(data, errors, extended, windows) if errors else {}
    return _in_noise(wrong, data, windows, whitener, np.ones(data.n_outputs, dtype=bool))


def _output_size(data: Dataset, windows: Sequence[tuple[int, Window]]) -> Array:
    y = np.concatenate([data.records[i].y[w.start : w.stop] for i, w in windows])
    size = np.std(y, axis=0)
    return np.asarray(np.where(size > 0.0, size, np.inf), dtype=float)


def _simulated_size(data: Dataset, residuals: Sequence[Array], windows: Sequence[tuple[int, Window]]) -> Array:
    """Return the rms about its mean of each simulated output on the held-out samples, (n_y,)."""
    rows = [(data.records[i].y - residuals[i])[w.start : w.stop] for i, w in windows]
    return np.asarray(np.std(np.concatenate(rows), axis=0), dtype=float)


def _cleaned(
    data: Dataset,
    residuals: Sequence[Array] | Mapping[int, Array],
    linear: ModalModel,
    windows: Sequence[tuple[int, Window]],
) -> dict[int, Array]:
    """Return residuals (n, n_y, …) of the records of `windows`, by number, without what the start of each window adds.

    An identification that never saw them is treated the same: free motion from earlier samples is an error there.
    """
    cleaned = {i: residuals[i].copy() for i in {i for i, _ in windows}}
    for i, w in windows:
        rows = slice(w.start, w.stop)
        cleaned[i][rows] = _without_start(residuals[i][rows], linear, data.rate_hz)
    return cleaned


def _squares(cleaned: Mapping[int, Array], windows: Sequence[tuple[int, Window]], size: Array) -> list[Array]:
    """Return, per window, each sample's squared relative residual, mean over the outputs, shape (rows,)."""
    moving = np.isfinite(size)
    if not moving.any():
        return [np.full(w.stop - w.start, np.nan) for _, w in windows]
    return [np.mean((cleaned[i][w.start : w.stop, moving] / size[moving]) ** 2, axis=1) for i, w in windows]


def _in_noise(
    cleaned: Mapping[int, Array],
    data: Dataset,
    windows: Sequence[tuple[int, Window]],
    whitener: Whitener,
    counted: NDArray[np.bool_],
) -> Array:
    """Return columns (n, n_y, k) of the `counted` outputs on held-out samples, whitened and joined, (rows, k).

    Residuals (n, n_y) are one column.
    """
    white = []
    for i, w in windows if cleaned else ():
        rows, values = np.zeros(data.records[i].n, dtype=bool), cleaned[i]
        rows[w.start : w.stop] = True
        each = (values[:, o].reshape(values.shape[0], -1) for o in range(counted.size))
        white += [whitener.rows(column, rows, o) for o, column in enumerate(each) if counted[o]]
    return np.concatenate(white) if white else np.zeros((0, 1))


def _times(before: Array, after: Array, errors: Array) -> tuple[float, float]:
    """Return the factor by which the change of whitened samples should be scaled, and the standard deviation of that.

    The change d that an extension makes of them is fitted to the residual before, b, by generalised least squares:
    d'V⁻¹b / d'V⁻¹d times d leaves least. V is the covariance of unit noise and of what `errors` of unit size
    (rows, k) add. On these samples both may be larger than assumed, by as much as the residual `after` (rows, 1)
    shows, like `before`.
    """
    before, after = before[:, 0], after[:, 0]
    change = before - after
    if not np.any(change):
        return 1.0, np.inf
    seen = np.stack([change, before, after], axis=1)
    products = seen.T @ seen
    if errors.size:
        # (I + E E')⁻¹ = I - E (I + E'E)⁻¹ E', whose middle is 1 / L L'
        inner = np.linalg.cholesky(np.eye(errors.shape[1]) + errors.T @ errors)
        known = scipy.linalg.solve_triangular(inner, errors.T @ seen, lower=True)
        products = products - known.T @ known
    weight, noise = float(products[0, 0]), max(1.0, float(products[2, 2]) / after.size)
    if not weight > 0.0:
        return 1.0, np.inf
    return float(products[0, 1]) / weight, float(np.sqrt(noise / weight))


def _most_noise(
    noise: Array,
    size: Array,
    whitener: Whitener,
    errors: Mapping[int, Array],
    windows: Sequence[tuple[int, Window]],
) -> float:
    """Return an upper limit, on these samples, of noise of this rms (n_y,) and of `errors` of unit size (n, n_y, k).

    It is relative to the outputs' `size` (n_y,). Slow noise has few degrees of freedom on any samples, and so have the
    errors: the sum of squares of normal numbers of several sizes is as that of equal ones with the same mean and
    variance (Satterthwaite, Biometrics Bulletin 2, 1946).
    """
    moving, rows = np.isfinite(size), sum(w.stop - w.start for _, w in windows)
    longest = max(w.stop - w.start for _, w in windows)
    power, mean = _spectrum(whitener, longest)[moving], _mean_square(whitener, longest)[moving]
    unit = (noise / size)[moving] ** 2 / (np.sum(power, axis=1) * np.count_nonzero(moving))
    parts = [0.5 * (power * unit[:, None]).ravel()] * 2 + [mean * unit]  # a line has two numbers, a mean is one
    if errors:
        joined = np.concatenate([errors[i][w.start : w.stop, moving] / size[moving, None] for i, w in windows])
        flat = joined.reshape(-1, joined.shape[2])
        parts.append(np.linalg.eigvalsh(flat.T @ flat / (rows * np.count_nonzero(moving))))
    each = np.concatenate(parts)
    equal = np.sum(each) ** 2 / max(float(np.sum(each**2)), np.finfo(float).tiny)
    return float(np.sqrt(np.sum(each) * chi2_limit(SELDOM, equal) / equal)) if equal > 0.0 else 0.0


def _rms(squares: Sequence[Array]) -> float:
    return float(np.sqrt(np.concatenate(squares).mean()))


def _without_start(residual: Array, linear: ModalModel, rate_hz: float) -> Array:
    """Return residuals (n, n_y, …) without what an unknown first state adds, one number for each state of `linear`.

    These numbers were fitted, so the residual has so many fewer degrees of freedom: noise keeps its size. In a window
    too short to distinguish them from its noise nothing is removed.
    """
    rows = residual.shape[0] * residual.shape[1]
    free = free_responses(discretise(linear, rate_hz), residual.shape[0]).reshape(rows, -1)
    if rows < LEAST_ROWS * free.shape[1]:
        return residual
    scale = np.linalg.norm(free, axis=0)
    free = free[:, scale > 0.0] / scale[scale > 0.0]
    flat = residual.reshape(rows, -1)
    states, _, rank, _ = np.linalg.lstsq(free, flat, rcond=1e-9)
    return np.asarray((flat - free @ states).reshape(residual.shape) * np.sqrt(rows / (rows - int(rank))))


def _block(data: Dataset, linear: ModalModel) -> int:
    """Return the bootstrap's block in samples: two periods of the slowest mode, in which a residual forgets itself."""
    swinging = linear.omega_rad_s[linear.omega_rad_s > 0.0]
    slowest = float(swinging.min()) if swinging.size else 0.0
    return max(int(2.0 * 2.0 * np.pi / slowest * data.rate_hz), 8) if slowest > 0.0 else 64


def _bootstrap(
    first: Sequence[Array], second: Sequence[Array], block: int, rng: np.random.Generator
) -> tuple[Array, float]:
    """Return the relative reduction in `DRAWS` resamples, (DRAWS,), and below what the rms of `second` hardly falls."""
    sums = np.zeros((2, DRAWS))
    for a, b in zip(first, second, strict=True):
        length = max(min(block, a.size // LEAST_BLOCKS), 1)
        number = max(a.size // length, 1)
        begin = rng.integers(0, a.size - length + 1, size=(DRAWS, number))
        for k, x in enumerate((a, b)):
            total = np.concatenate([[0.0], np.cumsum(x)])
            drawn = total[begin + length] - total[begin]
            # every window keeps its weight whatever number of whole blocks fits into it
            sums[k] += drawn.sum(axis=1) * (a.size / (number * length))
    rows = sum(b.size for b in second)
    least = float(np.sqrt(np.quantile(sums[1] / rows, SELDOM)))
    return 1.0 - np.sqrt(sums[1] / np.maximum(sums[0], np.finfo(float).tiny)), least


def _noise_rms(
    residuals: Mapping[int, Array], n_outputs: int, whitener: Whitener, windows: Sequence[tuple[int, Window]]
) -> Array:
    """Return the noise's rms per output, (n_y,): from repeated periods of the held-out samples, else from its model."""
    square, rows = np.zeros(n_outputs), 0
    for i, w in windows:
        begin, count = w.repeated
        if count < 2:
            continue
        periods = residuals[i][begin : begin + count * w.period].reshape(count, w.period, -1)
        square += np.sum((periods - periods.mean(axis=0)) ** 2, axis=(0, 1))
        rows += (count - 1) * w.period
    if rows:
        return np.sqrt(square / rows)
    return model_rms(whitener, max(w.stop - w.start for _, w in windows))


def model_rms(whitener: Whitener, rows: int) -> Array:
    """Return the rms about its mean, over `rows`, of the noise that `whitener` whitens, from its spectrum; (n_y,)."""
    return np.asarray(np.sqrt(_spectrum(whitener, rows).sum(axis=1)))


def _mean_square(whitener: Whitener, rows: int) -> Array:
    """Return the variance (n_y,) of the mean over `rows` of that noise: its spectrum below half a frequency bin."""
    frequency = np.asarray((np.arange(_BELOW) + 0.5) * (0.5 / (_BELOW * rows)), dtype=np.float64)
    response = whitener.taps @ np.exp(-2j * np.pi * np.outer(np.arange(whitener.taps.shape[1]), frequency))
    return np.asarray(_power(whitener, frequency, response).mean(axis=1) / rows)


def _spectrum(whitener: Whitener, rows: int) -> Array:
    """Return the squares of the noise that `whitener` whitens in the frequency bins of so many `rows`, (n_y, k)."""
    lines = max(rows, 4 * whitener.taps.shape[1])
    response = np.fft.rfft(whitener.taps, lines, axis=1)[:, 1:]
    frequency = np.arange(1, response.shape[1] + 1) / lines
    power = _power(whitener, frequency, response)
    power[:, : (lines - 1) // 2] *= 2.0  # the lines of the other sign; half the rate has none
    return np.asarray(power / lines)


def _power(whitener: Whitener, frequency: Array, response: NDArray[np.complex128]) -> Array:
    """Return the power (n_y, k) of that noise at each `frequency` (k,), where its filter has this response (n_y, k)."""
    return np.asarray(whitener.bands.at(frequency) / np.maximum(np.abs(response) ** 2, np.finfo(float).tiny))
