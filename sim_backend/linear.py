"""A linear model as a sum of second-order blocks: the one form of every plant here.

Each block is a pair of states (q, v) in companion form, so a badly scaled eighth-order polynomial never has to be
formed, every block is discretised exactly on its own, and rigid-body modes need no special case:

    dq/dt = v + B_direct u                       (B_direct is zero for a mechanical mode)
    dv/dt = -omega^2 q - 2 sigma v + B u
    y     = sum over blocks of (C q + C_rate v) + D u

with omega the undamped natural frequency (rad/s) and sigma the decay rate (s⁻¹). `B` and `C` are the participation of
the block in each input and output.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sim_backend.errors import ConfigError

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class ModalModel:
    """Sum of `m` second-order blocks from `n_u` inputs to `n_y` outputs, in continuous time.

    Shapes: `omega_rad_s` and `sigma_1_s` (m,); `b` and `b_direct` (m, n_u); `c` and `c_rate` (n_y, m); `d` (n_y, n_u);
    `delay_s` (n_u,), a pure delay of each input. A rigid body has omega 0; two real poles have sigma > omega.
    Raises ConfigError when a shape does not fit or a number is not finite.
    """

    omega_rad_s: Array
    sigma_1_s: Array
    b: Array
    b_direct: Array
    c: Array
    c_rate: Array
    d: Array
    delay_s: Array

    def __post_init__(self) -> None:
        m, n_u, n_y = self.omega_rad_s.size, self.b.shape[1], self.c.shape[0]
        wanted = ((m,), (m,), (m, n_u), (m, n_u), (n_y, m), (n_y, m), (n_y, n_u), (n_u,))
        arrays = vars(self)
        for (name, value), shape in zip(arrays.items(), wanted, strict=True):
            if value.shape != shape:
                raise ConfigError(
                    f"linear model: {name} has shape {value.shape}, needs {shape}; give one entry per block, input and "
                    f"output"
                )
        # all at once: a model is made in every step of a fit
        if not np.isfinite(np.concatenate(tuple(arrays.values()), axis=None)).all():
            name = next(n for n, value in arrays.items() if not np.isfinite(value).all())
            raise ConfigError(
                f"linear model: {name} holds a number that is not finite; every entry must be a real number"
            )
        if min(self.omega_rad_s.tolist(), default=0.0) < 0.0 or min(self.delay_s.tolist(), default=0.0) < 0.0:
            name, what = ("omega_rad_s", "block") if np.any(self.omega_rad_s < 0.0) else ("delay_s", "input")
            first = int(np.flatnonzero(arrays[name] < 0.0)[0])
            raise ConfigError(
                f"linear model: {name} of {what} {first + 1} is {arrays[name][first]:g}; it must be zero or more"
            )

    @property
    def n_blocks(self) -> int:
        """Number of second-order blocks."""
        return int(self.omega_rad_s.size)

    @property
    def n_inputs(self) -> int:
        """Number of inputs."""
        return int(self.b.shape[1])

    @property
    def n_outputs(self) -> int:
        """Number of outputs."""
        return int(self.c.shape[0])

    def with_(self, **changes: Array) -> ModalModel:
        """Return a copy with the named arrays replaced."""
        return replace(self, **changes)

    def only(self, keep: NDArray[np.bool_]) -> ModalModel:
        """Return the model with those of its blocks that `keep` (m,) marks, beside its direct paths and delays."""
        return self.with_(
            omega_rad_s=self.omega_rad_s[keep],
            sigma_1_s=self.sigma_1_s[keep],
            b=self.b[keep],
            b_direct=self.b_direct[keep],
            c=self.c[:, keep],
            c_rate=self.c_rate[:, keep],
        )

    def driven_by(self, inputs: Sequence[int] | NDArray[np.intp]) -> ModalModel:
        """Return the model from those of its inputs whose numbers (k,) are given, in their order."""
        keep = list(inputs)
        return self.with_(
            b=self.b[:, keep], b_direct=self.b_direct[:, keep], d=self.d[:, keep], delay_s=self.delay_s[keep]
        )

    def beside(self, other: ModalModel) -> ModalModel:
        """Return the model with the blocks of another one, of the same inputs and outputs, after its own."""
        return self.with_(
            omega_rad_s=np.append(self.omega_rad_s, other.omega_rad_s),
            sigma_1_s=np.append(self.sigma_1_s, other.sigma_1_s),
            b=np.concatenate([self.b, other.b]),
            b_direct=np.concatenate([self.b_direct, other.b_direct]),
            c=np.concatenate([self.c, other.c], axis=1),
            c_rate=np.concatenate([self.c_rate, other.c_rate], axis=1),
        )

    def poles_1_s(self) -> ComplexArray:
        """Return the poles (s⁻¹), shape (m, 2): -sigma ± sqrt(sigma^2 - omega^2)."""
        root = np.sqrt((self.sigma_1_s**2 - self.omega_rad_s**2).astype(complex))
        return np.stack([-self.sigma_1_s + root, -self.sigma_1_s - root], axis=1)

    def state_space(self) -> tuple[Array, Array, Array, Array]:
        """Return (A, B, C, D) with states ordered q0, v0, q1, v1, …; the delays are left out."""
        m = self.n_blocks
        a = np.zeros((2 * m, 2 * m))
        bb = np.zeros((2 * m, self.n_inputs))
        cc = np.zeros((self.n_outputs, 2 * m))
        for i in range(m):
            a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = self.block(i)
            bb[2 * i], bb[2 * i + 1] = self.b_direct[i], self.b[i]
            cc[:, 2 * i], cc[:, 2 * i + 1] = self.c[:, i], self.c_rate[:, i]
        return a, bb, cc, self.d.copy()

    def block(self, i: int) -> Array:
        """Return the 2 × 2 companion matrix of block `i`."""
        return np.array([[0.0, 1.0], [-(self.omega_rad_s[i] ** 2), -2.0 * self.sigma_1_s[i]]])

    def frequency_response(self, frequency_hz: Array, hold_rate_hz: float | None = None) -> ComplexArray:
        """Return the response, shape (n_f, n_y, n_u), in output units per input unit.

        With `hold_rate_hz` it is the exact response of the sampled system behind a zero-order hold at that rate
        (what a stepped sine on the bench measures); without, that of the continuous plant. Delays are included.
        """
        if hold_rate_hz is not None:
            return played(self, hold_rate_hz).frequency_response(frequency_hz)
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)[:, None]
        den = s**2 + 2.0 * self.sigma_1_s * s + self.omega_rad_s**2
        # (sI - A)^-1 of the companion block applied to [b_direct, b]; a mechanical mode has no direct parts
        direct = self.b_direct.any()
        q = (s + 2.0 * self.sigma_1_s)[..., None] * self.b_direct + self.b if direct else self.b
        out = np.einsum("ym,fmu->fyu", self.c, q / den[..., None])
        if self.c_rate.any():
            v = s[..., None] * self.b
            if direct:
                v -= (self.omega_rad_s**2)[:, None] * self.b_direct
            out += np.einsum("ym,fmu->fyu", self.c_rate, v / den[..., None])
        out += self.d
        return out * np.exp(-s[:, :, None] * self.delay_s) if self.delay_s.any() else out


@dataclass(frozen=True)
class DiscreteModel:
    """The exact zero-order-hold equivalent of a ModalModel at one rate.

    Shapes: `a` (m, 2, 2), `b` (m, 2, n_u), `c` (n_y, m, 2), `rate_c` (n_y, m, 2) and `rate_d` (n_y, n_u), which give
    the output's time derivative; `d` (n_y, n_u); `delay_samples` (n_u,), not necessarily whole.

    Where delays are `split`, `late` (m, 2, n_u) is the part of `b` that the older of two held samples drives: for the
    first part of a sample it still acts.
    """

    a: Array
    b: Array
    c: Array
    rate_c: Array
    rate_d: Array
    d: Array
    delay_samples: Array
    rate_hz: float
    late: Array | None = None

    def frequency_response(self, frequency_hz: Array) -> ComplexArray:
        """Return the response from the samples of the input to those of the output, shape (n_f, n_y, n_u)."""
        z = np.exp(2j * np.pi * np.asarray(frequency_hz, dtype=float) / self.rate_hz)
        # (zI - a)^-1 b block by block, by Cramer's rule
        first, second = z[:, None] - self.a[:, 0, 0], z[:, None] - self.a[:, 1, 1]
        upper, lower = self.a[:, 0, 1], self.a[:, 1, 0]
        per = 1.0 / (first * second - upper * lower)
        out = np.broadcast_to(self.d, (z.size, *self.d.shape)).astype(complex)
        for u, samples in enumerate(self.delay_samples):
            if self.late is None:
                taps, into = delay_taps(float(samples)), self.b[:, :, u]
                late = np.polyval(taps.weights[::-1], 1.0 / z) * z**-taps.first
            else:  # of two held samples the older drives its part, and is what a direct path still passes on
                whole, part = divmod(float(samples), 1.0)
                into, late = self.b[:, :, u] + (1.0 / z[:, None, None] - 1.0) * self.late[:, :, u], z**-whole
                if part > 0.0:
                    out[:, :, u] /= z[:, None]
            b0, b1 = into[..., 0], into[..., 1]
            out[:, :, u] += (per * (second * b0 + upper * b1)) @ self.c[:, :, 0].T
            out[:, :, u] += (per * (lower * b0 + first * b1)) @ self.c[:, :, 1].T
            out[:, :, u] *= late[:, None]
        return out


_CUBIC = np.array([[-1.0, 6.0, -11.0, 6.0], [3.0, -15.0, 18.0, 0.0], [-3.0, 12.0, -9.0, 0.0], [1.0, -3.0, 2.0, 0.0]])
"""Six times the weights of samples 0, 1, 2 and 3 in the cubic through them, by falling powers of where it is read."""

TAPS = _CUBIC.shape[0]
"""Held samples of an input's past that together stand for a delayed one."""


@dataclass(frozen=True)
class Taps:
    """Weights (4,) of held samples, the `first` of them so many samples ago; `slopes` (4,) per sample of delay."""

    first: int
    weights: Array
    slopes: Array

    @property
    def reach(self) -> int:
        """How many samples ago the last one was."""
        return self.first + self.weights.size - 1


def delay_taps(delay_samples: float) -> Taps:
    """Return the held samples that together act as the input `delay_samples` ago (not necessarily whole) does.

    A held input that arrives between two samples is not a sequence of held samples. A plant answers it as the cubic
    through the nearest four that have been, to third order in the angle per sample (Lagrange's interpolation). On a
    straight line between two, at a part f of a sample, what is fast would lose f (1 - f)/2 of the squared angle: more
    than a first-order lag of half a sample differs from a delay.
    """
    first = max(int(delay_samples) - 1, 0)
    x = delay_samples - first
    weights, slopes = _CUBIC @ [x**3, x**2, x, 1.0] / 6.0, _CUBIC @ [3.0 * x**2, 2.0 * x, 1.0, 0.0] / 6.0
    return Taps(first, weights, slopes)


_STRAIGHT = 0.125
"""Angle per step of the fastest mode up to which four held steps stand for a delayed one to one in 100,000."""

_WITHIN = 4
"""Fewest steps per sample beside a delay of parts of one. Commands jump from sample to sample, and four held samples
spread a jump over four: however slow the modes are, their readings are off by a thousandth of what white commands do.
Four steps keep most of it within the sample: 4e-5 at most, where the last fifth of a sample is left, else 1e-8."""


def late_within_samples(model: ModalModel, rate_hz: float) -> bool:
    """Tell whether any delay of `model` has a part of a sample."""
    late = model.delay_s * rate_hz
    return bool(np.any(np.abs(late - np.round(late)) >= 1e-9))


def finer_for_delays(model: ModalModel, rate_hz: float) -> int:
    """Return how many times faster than `rate_hz` a loop is to run for taps to stand for the delays of `model`.

    One where all delays are whole numbers of samples. The cubic through four steps is off by at most 1/24 of the fourth
    power of the angle per step.
    """
    if not late_within_samples(model, rate_hz):
        return 1
    angle = min(float(np.max(model.omega_rad_s, initial=0.0)) / rate_hz, np.pi)
    return max(int(np.ceil(angle / _STRAIGHT)), _WITHIN)


_TERMS = 18
"""Terms of the exponential's series: 0.5^18 / 18! is below 1e-20 of the first."""


def _held(omega_rad_s: Array, sigma_1_s: Array, time_s: float) -> tuple[Array, Array]:
    """Return what every block does in a time: e^(M t) and its integral over t, (m, 2, 2) each; M is the block's matrix.

    Both are a number and a number of times M.
    """
    numbers = [_held_block(o, s, time_s) for o, s in zip(omega_rad_s.tolist(), sigma_1_s.tolist(), strict=True)]
    whole, along, held, held_along = np.array(numbers).reshape(-1, 4).T
    return _block(omega_rad_s, sigma_1_s, whole, along), _block(omega_rad_s, sigma_1_s, held, held_along)


@lru_cache(maxsize=4096)
def _held_block(omega_rad_s: float, sigma_1_s: float, time_s: float) -> tuple[float, float, float, float]:
    """Return e^(M t) of one block's matrix M, as a number and a number of times M, and its integral over t likewise.

    By scaling and squaring (Moler and Van Loan, SIAM Review 45 (2003), method 3). M² = -ω² - 2σ M, so that each power
    of M is a number and a number of times M (Cayley and Hamilton). As plain numbers that takes some microseconds, a
    tenth of what arrays of so few do, and a fit turns one block of many at a time: the others are remembered.
    """
    fastest = max(omega_rad_s, 2.0 * sigma_1_s) * time_s
    halvings = max(math.ceil(math.log2(fastest / 0.5)), 0) if fastest > 0.0 else 0
    part = time_s / 2.0**halvings
    square, twice = (omega_rad_s * part) ** 2, 2.0 * sigma_1_s * part
    one, times = 1.0, 0.0  # of (M t)^k / k!, in units of M t, and the sums of these
    whole, along, held, held_along = 1.0, 0.0, 1.0, 0.0
    for k in range(1, _TERMS + 1):
        one, times = -square * times / k, (one - twice * times) / k
        whole, along = whole + one, along + times
        held, held_along = held + one / (k + 1), held_along + times / (k + 1)
    for _ in range(halvings):
        held, held_along = (
            (1.0 + whole) * held - square * along * held_along,
            (1.0 + whole - twice * along) * held_along + along * held,
        )
        whole, along = whole**2 - square * along**2, (2.0 * whole - twice * along) * along
    return whole, along * part, held * part, held_along * part**2


def _block(omega_rad_s: Array, sigma_1_s: Array, one: Array, times: Array) -> Array:
    """Return `one` + `times` M for every block, shape (m, 2, 2)."""
    out = np.empty((omega_rad_s.size, 2, 2))
    out[:, 0, 0], out[:, 0, 1] = one, times
    out[:, 1, 0], out[:, 1, 1] = -(omega_rad_s**2) * times, one - 2.0 * sigma_1_s * times
    return out


def nonzero(lengths: Array) -> Array:
    """Return `lengths`, any shape, with one for what has none: something to divide by."""
    return np.where(lengths > 0.0, lengths, 1.0)


def discretise(model: ModalModel, rate_hz: float, *, split: bool = False) -> DiscreteModel:
    """Return the exact zero-order-hold equivalent of `model` at `rate_hz`, block by block.

    Also for rigid bodies, whose matrix is singular. With `split`, delays that are no whole number of samples are exact
    as well (see `finer_for_delays`).
    Raises ConfigError when the rate is not positive.
    """
    if not rate_hz > 0.0:
        raise ConfigError(f"sample rate is {rate_hz} Hz; it must be above zero")
    omega, sigma = model.omega_rad_s, model.sigma_1_s
    into = np.stack([model.b_direct, model.b], axis=1)
    a, held = _held(omega, sigma, 1.0 / rate_hz)
    b = held @ into
    c = np.stack([model.c, model.c_rate], axis=2)
    rates = _block(omega, sigma, np.zeros_like(omega), np.ones_like(omega))
    rate_c = (c[:, :, None, :] @ rates)[:, :, 0]
    rate_d = np.einsum("ymk,mku->yu", c, into)
    late = _late(model, into, b, rate_hz) if split else None
    return DiscreteModel(a, b, c, rate_c, rate_d, model.d, model.delay_s * rate_hz, float(rate_hz), late)


def played(model: ModalModel, rate_hz: float) -> DiscreteModel:
    """Return `model` at one rate, behind held inputs, with delays of parts of a sample exact."""
    return discretise(model, rate_hz, split=late_within_samples(model, rate_hz))


def _late(model: ModalModel, into: Array, b: Array, rate_hz: float) -> Array:
    """Return the part (m, 2, n_u) of `b` that the older of the two samples drives which act within one.

    The newer drives the sample after the fraction of the delay, the older all before.
    """
    late = np.empty_like(b)
    for j, part in enumerate(model.delay_s * rate_hz % 1.0):
        _, held = _held(model.omega_rad_s, model.sigma_1_s, (1.0 - float(part)) / rate_hz)
        late[:, :, j] = b[:, :, j] - (held @ into[:, :, j, None])[:, :, 0]
    return late
