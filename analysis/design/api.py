"""From an identified model and recorded noise to a controller, axis by axis, with its expected performance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from analysis.design.expected import Motion
from analysis.design.feedback import FeedbackDesign, frequency_grid, safe_feedbacks
from analysis.design.learning import ENOUGH, WAIT_S, LearningDesign, design_learning
from analysis.design.magnetic_hysteresis import with_iron
from analysis.design.moves import Move
from analysis.design.noise import MeasuredNoise, measure_noise
from analysis.design.price import CUTOFFS_HZ, Price, affordable, price_curve, prices_of
from analysis.design.uncertainty import Tolerance, drawn_plants, late_samples
from analysis.recorded.chop import TIP_TILT
from analysis.recorded.requirements import SETTLING_S, STABILITY_RAD
from analysis.recorded.sweep import Sweep, sweep_of
from campaigns.log import Run
from campaigns.progress import Report, unheard
from campaigns.strategies.controller import AxisControl, Blocks, Controller, DesignedFor
from campaigns.strategies.design import Design
from sim_backend.bench import Limits
from sim_backend.control.inversion import advanced, periodic_input
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import ModalModel
from sim_backend.model import Model

Array = NDArray[np.float64]


TRIED = 8
"""Feedbacks around which learning is designed, the quietest first."""

MOST_SETTLING_S = 0.1
"""Longest time to design a move for: the dwell of the chop that its power is judged on."""


@dataclass(frozen=True)
class Options:
    """Targets and uncertainties of a design: the chop's stroke `reach_rad`, `settling_s`, `periods` of learning.

    With `most_w` an axis takes the fastest move of its curve whose chop dissipates no more, instead of `settling_s`.
    """

    reach_rad: float = 8.5e-3
    settling_s: float = SETTLING_S
    most_w: float | None = None
    periods: int = 20
    tolerance: Tolerance = Tolerance()
    plants: int = 100
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("reach_rad", "settling_s"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ConfigError(f"design: {name} is {value}; it must be a finite number above zero")
        if self.settling_s > MOST_SETTLING_S:
            raise ConfigError(
                f"design: settling_s is {self.settling_s:g}, the limit is {MOST_SETTLING_S:g}: choose a shorter time"
            )
        if self.most_w is not None and not (np.isfinite(self.most_w) and self.most_w > 0.0):
            raise ConfigError(f"design: a power of {self.most_w} W at most; it must be a finite number above zero")
        if self.periods < 2 or self.plants < 2:
            raise ConfigError(f"design: {self.periods} periods and {self.plants} plants; give two of each or more")


@dataclass(frozen=True)
class AxisDesign:
    """One designed axis: its control, everything that speaks for it, and the `curve` that its `price` lies on."""

    dof: str
    control: AxisControl
    noise: MeasuredNoise
    feedback: FeedbackDesign
    learning: LearningDesign
    price: Price
    curve: tuple[Price, ...]
    time_s: Array


@dataclass(frozen=True)
class Designed:
    """A controller with its axes, the limit of the amplifiers, and what it was made from: each run's UID and note."""

    controller: Controller
    axes: tuple[AxisDesign, ...]
    limit_a: float
    sources: Mapping[str, str]
    options: Options


def design_controller(
    model: Model,
    runs: Sequence[Run],
    limits: Limits,
    axes: Sequence[str],
    options: Options | None = None,
    report: Report = unheard,
) -> Designed:
    """Return the controller of every tilt axis that the model, the records and the bench's `axes` share.

    `runs` hold the noise at rest (test `rest`), and, where wanted, sweeps and hysteresis loops. `limits` are the
    bench's, whose inputs are `axes`. Raises ConfigError for runs of several benches and a design that would be
    unstable, break a limit or miss a requirement, DataError when no log holds the noise.
    """
    opts = options or Options()
    by_test: dict[str, list[Run]] = {}
    for run in runs:
        by_test.setdefault(run.header.test, []).append(run)
    if not by_test.get("rest"):
        raise DataError("design: no log of the bench at rest is given; record one, as `mccd design --bench` does")
    bench = bench_of(runs)
    known = with_iron(model, by_test.get("hysteresis", []))
    sweeps = [sweep_of(run) for run in by_test.get("sinesweep", [])]
    rest, rate = by_test["rest"][0], model.sample_rate_hz
    if rest.sample_rate_hz != rate:
        raise ConfigError(f"{rest.path} has {rest.sample_rate_hz:g} Hz, the model {rate:g} Hz; use one rate")
    driven = require_strokes(model, limits, axes, opts)
    if not driven:
        raise ConfigError(f"model '{model.name}' drives none of {', '.join(TIP_TILT)}; give a model of the tilt axes")
    rng = np.random.default_rng(opts.seed)
    made = []
    for i, dof in enumerate(driven):
        report(i, len(driven), f"feedback and learning of {dof}")
        sweep = next((s for s in sweeps if s.axis == dof), None)
        made.append(_design_axis(known, dof, rest, sweep, limits, axes, opts, rng))
    controller = Controller(
        name=f"designed on {model.name}",
        sample_rate_hz=rate,
        model=known,
        axes=[one.control for one in made],
        to_current=limits.to_current.tolist(),
        bench=bench,
    )
    sources = {run.run_uid: run.header.note for run in runs}
    return Designed(controller, tuple(made), float(limits.current_a), sources, opts)


def _design_axis(
    model: Model,
    dof: str,
    rest: Run,
    sweep: Sweep | None,
    limits: Limits,
    axes: Sequence[str],
    options: Options,
    rng: np.random.Generator,
) -> AxisDesign:
    rate, design, column = model.sample_rate_hz, Design(model, model.sample_rate_hz), list(axes).index(dof)
    plants = drawn_plants(model, dof, options.tolerance, options.plants, rng, options.reach_rad)
    noise = measure_noise(_quiet(rest, dof), plants[0], rate)
    try:
        curve = price_curve(design, dof, options.reach_rad, limits, column)
        most_w = np.inf if options.most_w is None else options.most_w
        allowed_s = options.settling_s if options.most_w is None else affordable(curve, most_w).allowed_s
        prices = prices_of(design, dof, options.reach_rad, allowed_s, limits, column)
        within = _within(prices, most_w, float(limits.current_a))
        feedbacks = list(islice(safe_feedbacks(plants, noise.noise, rate), TRIED))
        price, feedback, learning = _surest(plants, feedbacks, sweep, options, within, rate)
        _require("3σ on the worst plant", float(feedback.three_sigma_rad.max()), STABILITY_RAD, "rad")
    except ConfigError as error:
        raise ConfigError(f"axis '{dof}': {error}") from None
    late = late_samples(plants, rate)
    control = _control(dof, feedback, learning, price.move, options, rate, late)
    time_s = np.arange(price.motion_rad.size) / rate
    return AxisDesign(dof, control, noise, feedback, learning, price, curve, time_s)


def _within(prices: Iterable[Price], most_w: float, most_a: float) -> Iterator[Price]:
    """Yield the moves within power and peak current; raises ConfigError where none is."""
    least_a, found = np.inf, False
    for one in prices:
        least_a = min(least_a, one.peak_a)
        if not one.power_w > most_w and one.peak_a <= most_a:
            found = True
            yield one
    if not found:
        _require("peak current", least_a, most_a, "A")
        raise ConfigError(f"every move within {most_a:.3g} A dissipates more than {most_w:.3g} W; allow more of either")


def _surest(
    plants: list[ModalModel],
    feedbacks: Sequence[FeedbackDesign],
    sweep: Sweep | None,
    options: Options,
    prices: Iterable[Price],
    rate_hz: float,
) -> tuple[Price, FeedbackDesign, LearningDesign]:
    """Return move, feedback and learning with which most benches will meet what is asked, or the first that suffice.

    A move of little bandwidth holds more in the tail of its spectrum and needs a wider band, in which learning may not
    be sure; the first reason against any is raised where it is sure in none.
    """
    found: list[tuple[Price, FeedbackDesign, LearningDesign]] = []
    refused: list[ConfigError] = []
    for price in prices:
        try:
            found.append((price, *_loops(plants, feedbacks, sweep, options, price, rate_hz)))
        except ConfigError as error:
            refused.append(error)
            continue
        if _sure(*found[-1][1:]) >= ENOUGH:
            return found[-1]
    if not found:
        raise refused[0]
    return max(found, key=lambda one: _sure(*one[1:]))


def _sure(feedback: FeedbackDesign, learning: LearningDesign) -> float:
    """Return the part of the benches that will meet what is asked."""
    return feedback.quiet * learning.likely


def _loops(
    plants: list[ModalModel],
    feedbacks: Sequence[FeedbackDesign],
    sweep: Sweep | None,
    options: Options,
    price: Price,
    rate_hz: float,
) -> tuple[FeedbackDesign, LearningDesign]:
    """Return feedback and learning with which most benches will meet what is asked, or the first that suffice.

    What a feedback does to a sharp mode may make the closed loop too uncertain to learn around. Raises the reason
    against the first where learning is sure around none.
    """
    grid = frequency_grid(plants[0], rate_hz)
    # what opposes hysteresis in the drive is no error of the linear plants
    drive = advanced(periodic_input(plants[0], price.motion_rad, rate_hz), late_samples(plants, rate_hz))
    motion = Motion.of(price.motion_rad, drive, round(price.allowed_s * rate_hz))
    bands = [cutoff for cutoff in CUTOFFS_HZ if cutoff >= price.cutoff_hz]
    found: list[tuple[FeedbackDesign, LearningDesign]] = []
    refused: list[ConfigError] = []
    for feedback in feedbacks:
        if (found or refused) and feedback.three_sigma_rad.max() > STABILITY_RAD:
            break
        try:
            learning = design_learning(plants, feedback.controller, grid, sweep, options.periods, bands, motion)
        except ConfigError as error:
            refused.append(error)
            continue
        found.append((feedback, learning))
        if _sure(feedback, learning) >= ENOUGH:
            return found[-1]
    if not found:
        raise refused[0]
    return max(found, key=lambda both: _sure(*both))


def _quiet(rest: Run, dof: str) -> Array:
    segments = [s for s in rest.segments if s.settings.get("phase") == "rest"]
    if not segments or dof not in rest.channels:
        raise DataError(f"{rest.path} holds no rest of {dof}; record one with the plan 'rest'")
    return np.asarray(rest.read(dof, segments[0].start, segments[0].stop), dtype=float)


def _control(
    dof: str,
    feedback: FeedbackDesign,
    learning: LearningDesign,
    move: Move,
    options: Options,
    rate_hz: float,
    late: float,
) -> AxisControl:
    return AxisControl(
        dof=dof,
        reach_rad=options.reach_rad,
        move_samples=move.n_samples,
        concentration=move.concentration,
        feedback=Blocks.of(feedback.controller),
        learning=Blocks.of(learning.filter),
        lead_samples=learning.lead_samples,
        q_cutoff_hz=learning.cutoff_hz,
        q_half_length=learning.half_length,
        wait_s=WAIT_S,
        gains=list(learning.gains),
        shrinks_to=learning.shrinks_to,
        late_samples=late,
    )


def require_strokes(model: Model, limits: Limits, axes: Sequence[str], options: Options) -> list[str]:
    """Return the tilt axes to design; raises ConfigError for a move beyond both end stops of one of them."""
    driven = [dof for dof in TIP_TILT if dof in axes and dof in {p.dof for p in model.inputs}]
    for dof in driven:
        end_stop_rad = float(limits.reference[list(axes).index(dof)])
        if options.reach_rad > 2.0 * end_stop_rad:
            raise ConfigError(
                f"axis '{dof}': a move of {1e3 * options.reach_rad:g} mrad, the end stops are at "
                f"±{1e3 * end_stop_rad:.3g} mrad: choose a shorter move"
            )
    return driven


def bench_of(runs: Sequence[Run]) -> DesignedFor | None:
    """Return the bench that runs were measured on, None where none says so; raises ConfigError for several benches."""
    told = [(run, bench) for run in runs if (bench := DesignedFor.of(run.header.bench)) is not None]
    for run, bench in told:
        if bench != told[0][1]:
            raise ConfigError(
                f"{told[0][0].path} is of the bench {told[0][1]}, {run.path} of {bench}; design from the logs of one "
                "bench"
            )
    return told[0][1] if told else None


def require_of_bench(runs: Sequence[Run], identity: Mapping[str, str]) -> None:
    """Raise ConfigError for runs of another bench than that of `identity`, whose limits a design is to keep."""
    logged, here = bench_of(runs), DesignedFor.of(identity)
    if None not in (logged, here) and logged != here:
        raise ConfigError(
            f"the logs are of the bench {logged}, the bench to design for is {here}; give the one that they were "
            "recorded on (--bench; bench=… in Python)"
        )


def require_swept(runs: Sequence[Run], axes: Sequence[str]) -> None:
    """Raise ConfigError for an axis that no run sweeps: nothing tells whether the bench has the modes of the model."""
    swept = {s.settings.get("axis") for run in runs if run.header.test == "sinesweep" for s in run.segments}
    if missing := [axis for axis in axes if axis not in swept]:
        raise ConfigError(
            f"no log sweeps {' and '.join(missing)}: nothing tells whether the bench has the modes of the model; give "
            "the sweeps that `mccd identify` records, or --unswept to trust the model (unswept=True in Python)"
        )


def _require(what: str, value: float, limit: float, unit: str) -> None:
    """Raise ConfigError when a number that the design predicts lies beyond its limit."""
    if not value <= limit:
        raise ConfigError(
            f"{what} would be {value:.3g} {unit}, the limit is {limit:.3g} {unit}; "
            "allow more time for the move, or identify the axis better"
        )
