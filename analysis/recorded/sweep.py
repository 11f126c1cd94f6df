"""A recorded stepped sine: the frequency response of one axis, with its uncertainty."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.measurements.sinefit import SineFit, fit_sines, joined, sine_response
from analysis.measurements.thermal import SweepDifference, compare_sweeps
from campaigns.facts import facts_of, usable_segments
from campaigns.facts.clipping import NAME as CUT_OFF
from campaigns.facts.rest import AT_REST
from campaigns.log import LogSegment, Run
from sim_backend.errors import DataError

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ROWS_AT_ONCE = 250_000
"""Samples that are fitted together: few enough for the processor's cache, and memory does not grow with the sweep."""


@dataclass(frozen=True)
class Sweep:
    """Response of `axis` at rising frequencies, each array (f,), in output units per input unit.

    `variance` is E|error|² of `response`; `amplitude` that of the drive, in input units.
    """

    axis: str
    frequency_hz: Array
    response: ComplexArray
    variance: Array
    amplitude: Array

    @property
    def relative_std(self) -> Array:
        """Standard deviation (f,) of the magnitude over the magnitude, which is also that of the phase in rad."""
        return np.asarray(np.sqrt(0.5 * self.variance) / np.abs(self.response))

    @property
    def magnitude_db(self) -> Array:
        """Magnitude (f,) in dB of one output unit per input unit."""
        return np.asarray(20.0 * np.log10(np.abs(self.response)))


def difference_of(first: Sweep, second: Sweep) -> SweepDifference:
    """Return by how much the second sweep's magnitude differs from the first's; Fig. 6.17.

    Raises DataError when they are not over the same frequencies.
    """
    if not np.array_equal(first.frequency_hz, second.frequency_hz):
        raise DataError(
            f"sweeps over {first.frequency_hz.size} and {second.frequency_hz.size} frequencies that differ; "
            "record both with the same bands"
        )
    return compare_sweeps(first.frequency_hz, first.response, second.response, first.relative_std, second.relative_std)


def sweep_of(run: Run) -> Sweep:
    """Return the response that a stepped sine measured, by sine fits of its steady state; section 6.2.2.

    It is measured once for each open run, however many ask. Steps at rest or cut off by the sensor are left out. Raises
    DataError when the run holds no sine of known frequency, lacks the axis, or a fact forbids to use it.
    """
    return run.once("sweep", _measured)


def _is_step(segment: LogSegment) -> bool:
    return "frequency_hz" in segment.settings and "measure_from" in segment.settings


def _measured(run: Run) -> Sweep:
    played = [s for s in run.segments if _is_step(s)]
    if not played:
        raise DataError(
            f"{run.path} holds no stepped sine: it is a log of '{run.header.test}', give one of 'sinesweep'"
        )
    axis = str(played[0].settings.get("axis", ""))
    command = next((n for n in run.names("input") if run.channels[n].dof == axis), None)
    reading = next((n for n in run.names("output") if run.channels[n].dof == axis), None)
    if command is None or reading is None:
        lacks = " and ".join(what for what, name in (("command", command), ("reading", reading)) if name is None)
        raise DataError(f"{run.path} lacks the {lacks} of axis '{axis}'; record command and reading")
    parts = _whole(run, reading, [s for s in usable_segments(run) if _is_step(s)])
    fits = [_fitted(run, (command, reading), few, parts[0].start) for few in _gathered(parts)]
    inputs, outputs = (joined([fit.channel(i) for fit in fits]) for i in range(2))
    if not np.any(outputs.amplitude):
        raise DataError(f"{run.path}: '{reading}' never moves; give a log in which the sensor reads the axis")
    measured = sine_response(inputs, outputs)
    rising = np.argsort(measured.frequency_hz, kind="stable")
    return Sweep(
        axis,
        measured.frequency_hz[rising],
        measured.response[rising, 0, 0],
        measured.variance[rising, 0, 0],
        inputs.amplitude[rising, 0],
    )


def _whole(run: Run, reading: str, parts: list[LogSegment]) -> list[LogSegment]:
    """Return the steps in which the reading moves and is not cut off by its sensor: sines are fitted to whole steps."""
    useless = {fact.segment for fact in facts_of(run) if fact.name in (CUT_OFF, AT_REST) and fact.channel == reading}
    whole = [part for part in parts if part.label not in useless]
    if not whole:
        raise DataError(
            f"{run.path}: '{reading}' is cut off by its sensor or at rest in all {len(parts)} steps; check the sensor "
            "and the amplitude"
        )
    return whole


def _gathered(parts: list[LogSegment]) -> Iterator[list[LogSegment]]:
    """Yield consecutive segments that hold at most `ROWS_AT_ONCE` together, or a single longer one."""
    few: list[LogSegment] = []
    for part in parts:
        if few and part.stop - few[0].start > ROWS_AT_ONCE:
            yield few
            few = []
        few.append(part)
    yield few


def _fitted(run: Run, names: tuple[str, ...], parts: list[LogSegment], origin: int) -> SineFit:
    """Fit some neighbouring segments; phases count from sample `origin`."""
    first = parts[0].start
    start = np.array([s.start + int(s.settings["measure_from"]) for s in parts]) - first
    stop = np.array([s.stop for s in parts]) - first
    frequency = np.array([float(s.settings["frequency_hz"]) for s in parts])
    record = np.stack([run.read(n, first, parts[-1].stop) for n in names], axis=1)
    missing = np.argwhere(~np.isfinite(record))
    if missing.size:
        row, column = (int(i) for i in missing[0])
        raise DataError(
            f"{run.path}: '{names[column]}' holds no number in sample {first + row}, and steps are fitted whole; "
            "repair it, or record the sweep again"
        )
    return fit_sines(record, run.sample_rate_hz, start, stop, frequency, first_sample=first - origin)
