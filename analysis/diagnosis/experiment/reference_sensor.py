"""What an instrument beside the bench tells of its sensors: reading minus true angle, which only sensor effects change.

A gain of the sensor and a gain of the drive move the readings alike, so that no reading distinguishes them; a second
instrument does, because it sees the angle itself. Logs in which it watched decide between causes that are tied.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.experiment.hypotheses import Hypothesis, tied_hypotheses
from analysis.diagnosis.experiment.planned import Headroom, Played, bench_or_modelled, headroom_of, play_as
from analysis.diagnosis.experiment.separation import information, with_spread
from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.records.checks import check_same_bench
from analysis.diagnosis.records.loading import MAX_ROWS, Loaded, Source, check_finite, load_runs
from analysis.diagnosis.result import hypothesis_text
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import SURE
from analysis.diagnosis.verdict.judging import Judgement
from campaigns.log import Run, read_run, sha256_of
from campaigns.plans import Plan, make_plan
from sim_backend.bench import Bench
from sim_backend.errors import ConfigError
from sim_backend.linear import Array
from sim_backend.model import Model, number

Ints = NDArray[np.intp]

_STEP = 1e-3
"""Relative step by which a parameter is changed to see what that does to the readings: sensor effects are near linear
over it, and it is far above rounding."""

_ITERATIONS = 3
"""Gauss-Newton steps: a gain of the sensor enters the angles of a closed loop as 1/(1 + gain), and three are enough to
be exact there."""

NOISE_KNOWN = 0.1
"""How far the instrument's noise as the model states it may be from the truth (relative, of its variance) before its
readings count as unexplained."""


def watched_channels(channels: Iterable[tuple[str, str, str, str]], model: Model) -> list[tuple[int, str, str]]:
    """Return (output number, its reading's channel, the instrument's channel) of every output that is watched.

    `channels` are (name, role, dof, unit). An instrument's is an auxiliary channel of the output's degree of freedom in
    its unit. There is none when its noise is not known to `model`.
    """
    if model.hardware is None or model.hardware.theodolite_noise_rad is None:
        return []
    beside, read = {}, {}
    for name, role, dof, unit in channels:
        if role == "aux":
            beside[dof, unit] = name
        elif role == "output":
            read[dof, unit] = name
    ports = [(o, (p.dof, p.unit)) for o, p in enumerate(model.outputs)]
    return [(o, read[key], beside[key]) for o, key in ports if key in read and key in beside]


def watched_outputs(plan: Plan, bench: Bench, model: Model) -> tuple[int, ...]:
    """Return the numbers of the outputs that `plan` records on `bench` together with an instrument's channel."""
    kept = set(plan.channels(bench))
    channels = [(s.name, s.role, s.dof, s.unit) for s in bench.signals if s.name in kept]
    return tuple(o for o, _, _ in watched_channels(channels, model))


@dataclass(frozen=True)
class ReferenceSensor:
    """A plan that an instrument watches on a bench, with what is needed to play it on paper."""

    plan: Plan
    bench: Bench
    model: Model
    setting: Setting
    headroom: Headroom

    @property
    def watched(self) -> tuple[int, ...]:
        """Return the numbers of the outputs that the instrument watches."""
        return watched_outputs(self.plan, self.bench, self.model)

    def separation(self, first: Played, second: Hypothesis) -> float:
        """Return by how many sigma the instrument tells what `first` shows from `second`; 0 when it watches nothing."""
        watched = self.watched
        return self.misfit(error_of(first, watched), second) if watched else 0.0

    def misfit(self, error: Array, hypothesis: Hypothesis) -> float:
        """Return the root of the sum of squares with which `hypothesis` explains `error` (n, k) of the watched outputs.

        Its parameters adapt as far as their standard deviations let them, by Gauss-Newton steps; an offset between
        instrument and sensor is free. Infinite for a hypothesis that cannot play the plan within the limits.
        """
        fit = hypothesis.fit
        free = np.flatnonzero(np.isfinite(fit.std) & (fit.std > 0.0))
        precision = np.diag(1.0 / fit.std[free] ** 2)
        moved = np.zeros(free.size)
        total = float("inf")
        for _ in range(_ITERATIONS + 1):
            left = self._at(error, hypothesis, free, moved)
            if left is None:
                break
            total = min(total, float(left @ left + moved @ precision @ moved))
            columns = self._slopes(error, hypothesis, free, moved, left)
            normal = columns.T @ columns + precision
            moved = moved + np.linalg.solve(normal, columns.T @ left - precision @ moved)
        return float(np.sqrt(total))

    def _slopes(self, error: Array, hypothesis: Hypothesis, free: Ints, moved: Array, here: Array) -> Array:
        """Return by how much the residual shrinks per unit of each free parameter, whitened, (rows, k)."""
        columns = np.zeros((here.size, free.size))
        for k, i in enumerate(free):
            step = _STEP * (abs(float(hypothesis.fit.values[i])) or float(hypothesis.fit.std[i]))
            beside = self._at(error, hypothesis, free, moved + step * np.eye(free.size)[k])
            if beside is not None:
                columns[:, k] = (here - beside) / step
        return columns

    def _at(self, error: Array, hypothesis: Hypothesis, free: Ints, moved: Array) -> Array | None:
        """Return the residual of `error` with the parameters moved, whitened; None when that cannot be played."""
        try:
            changed = _changed(hypothesis, free, moved)
        except ConfigError:
            return None
        played = play_as(self.plan, self.bench, self.model, changed, self.setting, self.headroom)
        if played is None:
            return None
        # a run that was interrupted is shorter than its plan
        left = error - error_of(played, self.watched)[: error.shape[0]]
        return whitened_error(left, self.watched, self.setting.whitener, self.model)


def _changed(hypothesis: Hypothesis, free: Ints, moved: Array) -> Hypothesis:
    """Return the hypothesis with its free parameters moved; raises ConfigError beyond their bounds."""
    fit = hypothesis.fit
    values = fit.values.copy()
    values[free] += moved
    effects = list(fit.effects)
    for (owner, name), value in zip(fit.names, values, strict=True):
        changed: dict[str, Any] = {name: float(value)}
        effects[owner] = replace(effects[owner], **changed)
    return replace(hypothesis, fit=replace(fit, effects=tuple(effects)))


def error_of(played: Played, watched: tuple[int, ...]) -> Array:
    """Return reading minus true position (n, k) of the watched outputs."""
    return np.asarray((played.record.y - played.position)[:, watched], dtype=float)


def whitened_error(error: Array, watched: tuple[int, ...], whitener: Whitener, model: Model) -> Array:
    """Return `error` (n, k) of the watched outputs in numbers of unit variance, (2 n k,): real and imaginary parts.

    Its noise is that of the readings plus the instrument's, which is white; their mean, an offset, is left out.
    """
    assert model.hardware is not None and model.hardware.theodolite_noise_rad is not None
    own = number(model.hardware.theodolite_noise_rad) ** 2
    n = error.shape[0]
    lines = np.fft.fft(error, axis=0) / np.sqrt(n)
    frequency = np.abs(np.fft.fftfreq(n))
    levels = whitener.bands.at(frequency)
    parts = []
    for k, o in enumerate(watched):
        power = levels[o] / np.maximum(np.abs(np.fft.fft(whitener.taps[o], n)) ** 2, np.finfo(float).tiny)
        white = (lines[:, k] / np.sqrt(power + own))[1:]
        parts += [white.real, white.imag]
    return np.concatenate(parts)


@dataclass(frozen=True)
class ReferenceRun:
    """The plan that was played, and reading minus instrument (n, k) of the `watched` outputs (numbers of the model)."""

    plan: Plan
    watched: tuple[int, ...]
    error: Array


def load_logs(
    paths: Sequence[str | Path], model: Model, *, max_rows: int = MAX_ROWS
) -> tuple[Loaded, tuple[ReferenceRun, ...]]:
    """Return the records of all logs that hold the motion, and the reference runs of those that an instrument watched.

    A log without any command is a reference run when it holds readings beside an instrument's. Raises as `load_runs`.
    """
    motion, references, sources = [], [], []
    for path in paths:
        with read_run(path) as run:
            found = None if run.names("input") else reference_run_of(run, model)
            if found is None:
                motion.append(path)
                continue
            references.append(found)
            sources.append(
                Source(str(run.path), sha256_of(run.path), run.run_uid, found.error.shape[0], run.header.note)
            )
    loaded = load_runs(motion, model, max_rows=max_rows)
    check_same_bench(loaded, model)
    return replace(loaded, sources=(*loaded.sources, *sources)), tuple(references)


def reference_run_of(run: Run, model: Model) -> ReferenceRun | None:
    """Return what an instrument saw in a run of one of our plans, None when there was none or it has no such plan."""
    channels = [(name, c.role, c.dof, c.unit) for name, c in run.channels.items()]
    pairs = watched_channels(channels, model)
    try:
        configuration = json.loads(run.header.configuration)
        plan = make_plan(configuration["plan"], configuration["settings"])
    except (ValueError, KeyError, TypeError, ConfigError):
        return None
    if not pairs:
        return None
    names = [name for _, reading, beside in pairs for name in (reading, beside)]
    values = np.stack([run.read(name) for name in names], axis=1)
    check_finite(values, names, str(run.path), 0)
    return ReferenceRun(plan, tuple(o for o, _, _ in pairs), values[:, 0::2] - values[:, 1::2])


def weigh_references(
    found: Found, judgement: Judgement, references: Sequence[ReferenceRun], model: Model, bench: Bench | None
) -> tuple[Found, Judgement, str]:
    """Return search and verdict after all reference runs, and a remark on what they did.

    Each tied cause gets the likelihood of what the instrument measured, its parameters free within their standard
    deviations; rivals that were further behind are taken to explain it as well as the best. Search and verdict are
    unchanged where fewer than two causes are tied, no run is given, or no tied cause explains the measurements. If the
    causes stay tied, only their posteriors change.
    """
    hypotheses = tied_hypotheses(found, judgement) if judgement.verdict == "ambiguous" and references else []
    if len(hypotheses) < 2:
        return found, judgement, ""
    setting = found.setting
    hypotheses = [with_spread(setting, h, information(setting, h)) for h in hypotheses]
    description = bench_or_modelled(bench, model, setting.data.rate_hz)
    headroom = headroom_of(description, setting)
    squares = np.zeros(len(hypotheses))
    numbers = 0
    for one in references:
        sensor = ReferenceSensor(one.plan, description, model, setting, headroom)
        squares += [sensor.misfit(one.error, h) ** 2 for h in hypotheses]
        numbers += (one.error.shape[0] - 1) * one.error.shape[1]
    if not np.min(squares) / numbers <= 1.0 + NOISE_KNOWN + 5.0 * math.sqrt(2.0 / numbers):
        return found, judgement, "none of the tied causes explains what the instrument beside the bench saw"
    return _weighed(found, judgement, hypotheses, squares)


def _weighed(
    found: Found, judgement: Judgement, hypotheses: Sequence[Hypothesis], squares: Array
) -> tuple[Found, Judgement, str]:
    before = {name: -float(value) for name, value in judgement.rivals}
    labels = ["+".join(h.names) for h in hypotheses]
    total = np.array([before.get(label, 0.0) for label in labels]) + 0.5 * (squares - np.min(squares))
    gaps = dict(zip(labels, total - np.min(total), strict=True))
    gaps |= {label: gap - float(np.min(total)) for label, gap in before.items() if label not in gaps}
    top = int(np.argmin(total))
    winner = gaps.pop(labels[top])
    probability = float(1.0 / (1.0 + sum(math.exp(winner - gap) for gap in gaps.values())))
    rivals = tuple(sorted(((label, -gap) for label, gap in gaps.items()), key=lambda pair: -pair[1]))
    fit = hypotheses[top].fit
    others = [f for f in (found.best, *found.rivals) if f is not fit]
    if probability < SURE:
        return found, replace(judgement, rivals=rivals, probability=probability), "the instrument left them tied"
    named = replace(
        judgement,
        verdict="named",
        named=tuple(range(len(fit.effects))),
        tied=(),
        probability=probability,
        rivals=rivals,
    )
    cause = hypothesis_text(labels[top])
    remark = f"{cause} is named by what the instrument beside the bench saw; the readings alone leave it tied"
    return replace(found, best=fit, rivals=tuple(others)), named, remark
