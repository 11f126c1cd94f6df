"""Random-phase multisines on all axes at once: response, noise and nonlinear distortion, separated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from campaigns.plans.base import Plan, Reach, axis_of, channels_of, open_loop, rate_of, rounded
from campaigns.sizes import samples_of_wave
from sim_backend.bench import Bench, Segment
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]


PEAK_FACTOR = 3.5
"""Crest factor of a random-phase multisine of some hundred frequencies, as of normal noise: exceeded once in 2000."""


class Multisine(Plan, frozen=True, kw_only=True):
    """Periodic multisines from `start_hz` to `stop_hz`: all multiples of 1/`period_s`, of equal amplitude.

    Each of `realisations` draws new phases from `seed` and is played as one experiment per axis, the phases of the axes
    shifted relative to each other by the rows of a Fourier matrix, so that the inputs of a realisation are orthogonal
    (Pintelon and Schoukens, System Identification, 2012, 3.7). An experiment is `transient_periods` and `periods`.
    `torque_rms_nm` (N m) acts on angles, `force_rms_n` (N) on z. A last, held-out realisation has `held_out_gain` times
    that.
    """

    name: ClassVar[str] = "multisine"
    title: ClassVar[str] = "random-phase multisines"

    axes: tuple[str, ...] = ("theta_x", "theta_y", "z")
    torque_rms_nm: float = 0.01
    force_rms_n: float = 0.1
    start_hz: float = 1.0
    stop_hz: float = 2000.0
    period_s: float = 1.0
    periods: int = 2
    transient_periods: int = 1
    realisations: int = 2
    held_out_gain: float = 0.6
    seed: int = 0

    def __post_init__(self) -> None:
        self.require_positive("torque_rms_nm", "force_rms_n", "start_hz", "stop_hz", "period_s", "periods")
        self.require_positive("realisations", "held_out_gain")
        self.require(self.transient_periods >= 0 and self.seed >= 0, "transient_periods", "zero or more, as the seed")
        self.require(0 < len(self.axes) == len(set(self.axes)), "axes", "at least one axis, each once")
        self.require(self.stop_hz >= self.start_hz, "stop_hz", f"at least start_hz, {self.start_hz:g}")

    @classmethod
    def offers(cls, bench: Bench, reach: Reach) -> Iterator[Self]:
        """Yield two bands: all frequencies, and those up to 20 Hz, where the same torque goes with more travel."""
        sizes = reach.sizes(bench)
        for stop_hz, period_s in ((min(2000.0, 0.4 * rate_of(bench)), 0.5), (20.0, 1.0)):
            yield cls(
                axes=reach.axes,
                torque_rms_nm=rounded(sizes["torque"] / PEAK_FACTOR) if "torque" in sizes else cls().torque_rms_nm,
                force_rms_n=rounded(sizes["force"] / PEAK_FACTOR) if "force" in sizes else cls().force_rms_n,
                stop_hz=stop_hz,
                period_s=period_s,
                start_hz=1.0 / period_s,
                realisations=1,
            )

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return commands and readings, and the temperature."""
        return channels_of(bench, ("input", "output"), ("temperature",))

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield one segment per realisation and axis; raises ConfigError for an axis that is not there."""
        rate, record = rate_of(bench), self.channels(bench)
        where = [axis_of(bench, axis) for axis in self.axes]
        rms = np.array([self.force_rms_n if axis == "z" else self.torque_rms_nm for axis in self.axes])
        rng = np.random.default_rng(self.seed)
        period = samples_of_wave(self.period_s, rate)
        experiments = (self.realisations + 1) * len(where)
        self.require_run(bench, experiments * (self.transient_periods + self.periods) * period, experiments)
        for realisation in range(self.realisations + 1):
            held_out = realisation == self.realisations
            gain = self.held_out_gain if held_out else 1.0
            name = "held-out" if held_out else f"{realisation + 1}"
            for experiment, wave in enumerate(orthogonal(period, rate, self.start_hz, self.stop_hz, len(where), rng)):
                command = np.zeros((period, len(bench.axes)))
                command[:, where] = wave * rms * gain
                settings: dict[str, float | str] = {
                    "phase": "multisine",
                    "period_samples": period,
                    "transient_periods": self.transient_periods,
                    "periods": self.periods,
                    "realisation": realisation,
                    "experiment": experiment,
                }
                n = (self.transient_periods + self.periods) * period
                yield open_loop(f"multisine {name}.{experiment + 1}", command, n, record, settings)


def orthogonal(
    period: int, rate_hz: float, start_hz: float, stop_hz: float, n_axes: int, rng: np.random.Generator
) -> Iterator[Array]:
    """Yield `n_axes` experiments (period, n_axes) of unit rms each, on one draw of phases.

    At every line the matrix of inputs over experiments is a unitary one times the line's amplitude. Raises
    ConfigError when no line lies in the band.
    """
    resolution = rate_hz / period
    low, high = (min(f, rate_hz) / resolution for f in (start_hz, stop_hz))  # beyond the rate there is no line
    first, last = max(int(np.ceil(low - 1e-9)), 1), min(int(np.floor(high + 1e-9)), (period - 1) // 2)
    if last < first:
        raise ConfigError(
            f"multisine: no line of {resolution:g} Hz lies between {start_hz:g} and {stop_hz:g} Hz; "
            "lengthen the period or widen the band"
        )
    lines = np.arange(first, last + 1)
    phases = rng.uniform(0.0, 2.0 * np.pi, (lines.size, n_axes))
    # a line of amplitude a has the mean square a²/2
    amplitude = np.sqrt(2.0 / lines.size)
    for experiment in range(n_axes):
        turn = 2.0 * np.pi * experiment * np.arange(n_axes) / n_axes
        spectrum = np.zeros((period // 2 + 1, n_axes), dtype=complex)
        spectrum[lines] = 0.5 * period * amplitude * np.exp(1j * (phases + turn))
        yield np.fft.irfft(spectrum, period, axis=0)
