"""Logs in which an instrument beside the bench watched its sensors: what they say about causes that are tied."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.experiment.hypotheses import Hypothesis, tied_hypotheses
from analysis.diagnosis.experiment.next_experiment import room_of
from analysis.diagnosis.experiment.planned import face_of
from analysis.diagnosis.experiment.separation import information, with_spread
from analysis.diagnosis.experiment.witness import Witness, watched_channels
from analysis.diagnosis.records.another_bench import check_same_bench
from analysis.diagnosis.records.channels import check_finite
from analysis.diagnosis.records.loading import MAX_ROWS, Loaded, Source, load_runs
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import SURE
from analysis.diagnosis.verdict.judging import Judgement
from campaigns.log import Run, read_run, sha256_of
from campaigns.plans import Plan, make_plan
from sim_backend.bench import Bench
from sim_backend.errors import ConfigError
from sim_backend.model import Model

Array = NDArray[np.float64]

NOISE_KNOWN = 0.1
"""How far the instrument's noise as the model states it may be from the truth (relative, of its variance) before its
readings count as unexplained."""


@dataclass(frozen=True)
class Testimony:
    """The plan that was played, and reading minus instrument (n, k) of the `watched` outputs (numbers of the model)."""

    plan: Plan
    watched: tuple[int, ...]
    error: Array


def load_logs(
    paths: Sequence[str | Path], model: Model, *, max_rows: int = MAX_ROWS
) -> tuple[Loaded, tuple[Testimony, ...]]:
    """Return the records of all logs that hold the motion, and the testimonies of those that an instrument watched.

    A log without any command is a testimony when it holds readings beside an instrument's. Raises as `load_runs`.
    """
    motion, heard, sources = [], [], []
    for path in paths:
        with read_run(path) as run:
            found = None if run.names("input") else testimony_of(run, model)
            if found is None:
                motion.append(path)
                continue
            heard.append(found)
            sources.append(
                Source(str(run.path), sha256_of(run.path), run.run_uid, found.error.shape[0], run.header.note)
            )
    loaded = load_runs(motion, model, max_rows=max_rows)
    check_same_bench(loaded, model)
    return replace(loaded, sources=(*loaded.sources, *sources)), tuple(heard)


def testimony_of(run: Run, model: Model) -> Testimony | None:
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
    return Testimony(plan, tuple(o for o, _, _ in pairs), values[:, 0::2] - values[:, 1::2])


def hear(
    found: Found, judgement: Judgement, heard: Sequence[Testimony], model: Model, bench: Bench | None
) -> tuple[Found, Judgement, str]:
    """Return search and verdict after all testimonies, and a remark on what they did; unchanged when nothing is tied.

    Each tied cause gets the likelihood of what the instrument saw, its parameters free within their standard
    deviations; rivals that were further behind are taken to explain it as well as the best.
    """
    hypotheses = tied_hypotheses(found, judgement) if judgement.verdict == "ambiguous" and heard else []
    if len(hypotheses) < 2:
        return found, judgement, ""
    setting = found.setting
    hypotheses = [with_spread(setting, h, information(setting, h)) for h in hypotheses]
    face = face_of(bench, model, setting.data.rate_hz)
    room = room_of(face, setting)
    squares = np.zeros(len(hypotheses))
    numbers = 0
    for one in heard:
        witness = Witness(one.plan, face, model, setting, room)
        squares += [witness.misfit(one.error, h) ** 2 for h in hypotheses]
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
    remark = f"{labels[top]} is named by what the instrument beside the bench saw; the readings alone leave it tied"
    return replace(found, best=fit, rivals=tuple(others)), named, remark
