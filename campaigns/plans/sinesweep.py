"""Stepped sine on one axis, open loop: the frequency response of 6.2.2."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import ClassVar

import msgspec
import numpy as np

from campaigns.plans.base import Plan, axis_of, on_axis, open_loop, rate_of
from campaigns.sizes import samples_of
from sim_backend.bench import Bench, Segment
from sim_backend.errors import ConfigError

MAX_PERIOD = 200_000
"""Longest waveform in samples that a frequency may need: 20 s at 10 kHz."""


class Band(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Frequencies from `start_hz` to `stop_hz` (both played) in steps of `step_hz`, each at `gain` times the amplitude.

    Every frequency is played for `settle_s` before it is measured for `measure_s`, both rounded up to whole cycles.
    """

    start_hz: float
    stop_hz: float
    step_hz: float
    gain: float = 1.0
    settle_s: float = 0.4
    measure_s: float = 0.2

    def frequencies_hz(self) -> list[float]:
        """Return the frequencies of the band."""
        return [self.start_hz + i * self.step_hz for i in range(int(self.steps()) + 1)]

    def steps(self) -> float:
        """Return how many steps there are between the first frequency and the last, whole but for a fraction."""
        return (self.stop_hz - self.start_hz) / self.step_hz + 1e-9


# The resolution is the paper's: 5 Hz in 5–600 and 1400–1500 Hz, 50 Hz elsewhere. Amplitudes grow with frequency,
# because the response falls with its square: the gains keep it between 1 µrad and 4 mrad, the resonance at 30 Hz
# included. Waits are four time constants (0.2 s) of the 30 Hz mode where it rings, less where faster ones do.
PAPER_BANDS = (
    Band(start_hz=5.0, stop_hz=100.0, step_hz=5.0, settle_s=1.2, measure_s=0.4),
    Band(start_hz=105.0, stop_hz=600.0, step_hz=5.0, gain=20.0),
    Band(start_hz=650.0, stop_hz=1350.0, step_hz=50.0, gain=100.0),
    Band(start_hz=1400.0, stop_hz=1500.0, step_hz=5.0, gain=100.0),
    Band(start_hz=1550.0, stop_hz=2000.0, step_hz=50.0, gain=100.0),
)


class SineSweep(Plan, frozen=True, kw_only=True):
    """Stepped sine of `amplitude` (N m on an angle, N on z) times each band's gain, at the temperature `cold_finger_k`.

    Every frequency is one segment of whole cycles in whole samples, so the phase is continuous; its settings say
    frequency, amplitude and from which sample on it is measured.
    """

    name: ClassVar[str] = "sinesweep"
    title: ClassVar[str] = "stepped sine sweep"

    axis: str = "theta_x"
    amplitude: float = 0.002
    bands: tuple[Band, ...] = PAPER_BANDS
    cold_finger_k: float | None = None

    def __post_init__(self) -> None:
        self.require_positive("amplitude")
        for band in self.bands:
            if not (0.0 < band.start_hz <= band.stop_hz < math.inf and band.step_hz > 0.0):
                raise ConfigError(
                    f"plan {self.name}: a band goes from {band.start_hz:g} to {band.stop_hz:g} Hz in steps of "
                    f"{band.step_hz:g}; it needs 0 < start <= stop and a step above zero"
                )
            if not (band.gain > 0.0 and band.measure_s > 0.0 and band.settle_s >= 0.0):
                raise ConfigError(
                    f"plan {self.name}: the band from {band.start_hz:g} Hz has gain {band.gain:g}, settle_s "
                    f"{band.settle_s:g} and measure_s {band.measure_s:g}; gain and measure_s must be above zero"
                )

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return the command of the axis, all readings, and the temperature."""
        dof = bench.axes[axis_of(bench, self.axis)]
        return tuple(
            s.name
            for s in bench.signals
            if (s.role == "input" and s.dof == dof) or s.role == "output" or s.name == "temperature"
        )

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield one segment per frequency; raises ConfigError for one beyond half the rate or without whole cycles."""
        rate, record = rate_of(bench), self.channels(bench)
        shortest_s = sum((band.steps() + 1.0) * (band.settle_s + band.measure_s) for band in self.bands)
        self.require_run(bench, shortest_s * rate, sum(band.steps() for band in self.bands))
        set_point = self.cold_finger_k
        for band in self.bands:
            for wanted_hz in band.frequencies_hz():
                cycles, period = self._whole(wanted_hz, rate)
                settle = -(-samples_of(band.settle_s, rate) // period) * period if band.settle_s else 0
                measure = -(-samples_of(band.measure_s, rate) // period) * period
                amplitude = self.amplitude * band.gain
                sine = amplitude * np.sin(2.0 * np.pi * cycles * np.arange(period) / period)
                settings: dict[str, float | str] = {
                    "axis": self.axis,
                    "frequency_hz": cycles * rate / period,
                    "amplitude": amplitude,
                    "measure_from": settle,
                }
                wave = on_axis(bench, self.axis, sine)
                label = f"{wanted_hz:g} Hz"
                yield open_loop(label, wave, settle + measure, record, settings, cold_finger_k=set_point)
                set_point = None

    def _whole(self, frequency_hz: float, rate_hz: float) -> tuple[int, int]:
        """Return (cycles, samples) of the shortest waveform of whole cycles in whole samples at this frequency."""
        if not frequency_hz < 0.5 * rate_hz:
            raise ConfigError(
                f"plan {self.name}: {frequency_hz:g} Hz at a sample rate of {rate_hz:g} Hz; stay below half of it"
            )
        ratio = (Fraction(frequency_hz) / Fraction(rate_hz)).limit_denominator(MAX_PERIOD)
        if abs(float(ratio) * rate_hz - frequency_hz) > 1e-9 * frequency_hz:
            raise ConfigError(
                f"plan {self.name}: {frequency_hz!r} Hz has no whole cycles within {MAX_PERIOD} samples at "
                f"{rate_hz:g} Hz; choose {float(ratio) * rate_hz:.6g} Hz or a rounder number"
            )
        return ratio.numerator, ratio.denominator
