"""A random free run: noise and steps over the whole range, with held-out stretches of other size and waveform."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from campaigns.plans.base import Plan, Reach, axis_of, channels_of, open_loop, rate_of, smooth_ramp
from campaigns.plans.multisine import orthogonal
from campaigns.sizes import MOST_SEGMENTS, samples_of_wave
from sim_backend.bench import Bench, Segment

Array = NDArray[np.float64]


class FreeRun(Plan, frozen=True, kw_only=True):
    """Open loop on `axes`: `steps_s` of random levels, `noise_s` of noise, then the same held out at `held_out_gain`.

    Steps go to uniformly random levels of up to `torque_nm` (N m, angles) or `force_n` (N, z) along half a cosine in
    `move_s` and stay for `dwell_s`, so that position, direction and rest all vary. Noise is Gaussian with all
    frequencies up to `noise_stop_hz`, of a fifth of that size (rms). Of the held-out part the noise is a multisine at
    other frequencies.
    """

    name: ClassVar[str] = "freerun"
    title: ClassVar[str] = "random free run"

    axes: tuple[str, ...] = ("theta_x", "theta_y", "z")
    torque_nm: float = 0.045
    force_n: float = 0.1
    move_s: float = 0.05
    dwell_s: float = 0.2
    steps_s: float = 10.0
    noise_s: float = 5.0
    noise_stop_hz: float = 200.0
    held_out_gain: float = 0.7
    held_out_s: float = 4.0
    seed: int = 0

    def __post_init__(self) -> None:
        self.require_positive("torque_nm", "force_n", "move_s", "dwell_s", "steps_s", "noise_s", "noise_stop_hz")
        self.require_positive("held_out_gain", "held_out_s")
        self.require(self.seed >= 0, "seed", "zero or more")
        self.require(0 < len(self.axes) == len(set(self.axes)), "axes", "at least one axis, each once")

    @classmethod
    def offers(cls, bench: Bench, reach: Reach) -> Iterator[Self]:
        """Yield a run of a few seconds."""
        sizes = reach.sizes(bench)
        yield cls(
            axes=reach.axes,
            torque_nm=sizes.get("torque", cls().torque_nm),
            force_n=sizes.get("force", cls().force_n),
            noise_stop_hz=min(200.0, 0.2 * rate_of(bench)),
            steps_s=3.0,
            noise_s=1.5,
            held_out_s=1.0,
        )

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return commands and readings, and the temperature."""
        return channels_of(bench, ("input", "output"), ("temperature",))

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield steps, noise, and both again held out; raises ConfigError for an axis that is not there."""
        rate, record = rate_of(bench), self.channels(bench)
        where = [axis_of(bench, axis) for axis in self.axes]
        size = np.array([self.force_n if axis == "z" else self.torque_nm for axis in self.axes])
        rng = np.random.default_rng(self.seed)
        steps, noise, held_out = (samples_of_wave(t, rate) for t in (self.steps_s, self.noise_s, self.held_out_s))
        waves = {
            "steps": size * self._steps(steps, rate, rng),
            "noise": 0.2 * size * self._noise(noise, rate, rng),
            "held-out steps": self.held_out_gain * size * self._steps(held_out, rate, rng),
            "held-out multisine": 0.2 * self.held_out_gain * size * self._multisine(held_out, rate, rng),
        }
        for label, wave in waves.items():
            command = np.zeros((wave.shape[0], len(bench.axes)))
            command[:, where] = wave
            yield open_loop(label, command, wave.shape[0], record, {"phase": label.removeprefix("held-out ")})

    def _steps(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """Levels within ±1, shape (n, axes), beginning and ending at zero."""
        move, dwell = samples_of_wave(self.move_s, rate_hz), samples_of_wave(self.dwell_s, rate_hz)
        self.require(
            n / (move + dwell) <= MOST_SEGMENTS, "dwell_s", f"so long that there are at most {MOST_SEGMENTS} steps"
        )
        out, at = np.zeros((n, len(self.axes))), np.zeros(len(self.axes))
        for first in range(0, n, move + dwell):
            last = first + move + dwell >= n
            level = np.zeros(len(self.axes)) if last else rng.uniform(-1.0, 1.0, len(self.axes))
            part = np.vstack([smooth_ramp(at, level, move), np.tile(level, (dwell, 1))])[: n - first]
            out[first : first + part.shape[0]] = part
            at = level
        return out

    def _noise(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """Gaussian noise of unit rms up to the stop frequency, shape (n, axes)."""
        spectrum = np.fft.rfft(rng.standard_normal((n, len(self.axes))), axis=0)
        spectrum[np.fft.rfftfreq(n, 1.0 / rate_hz) > self.noise_stop_hz] = 0.0
        wave = np.fft.irfft(spectrum, n, axis=0)
        return np.asarray(wave / np.sqrt(np.mean(wave**2, axis=0)))

    def _multisine(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        return next(orthogonal(n, rate_hz, 0.5, 2.0 * self.noise_stop_hz, len(self.axes), rng))
