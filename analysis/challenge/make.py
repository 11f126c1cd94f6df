"""Make a challenge: cases with their logs and nominal models, and the sealed truth apart from them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from analysis.challenge.bounds import bound_deviations, held_out_floor
from analysis.challenge.draw import Drawn, Plan, draw_case, separable
from analysis.challenge.experiment import Run
from analysis.challenge.families import members, slugs
from analysis.challenge.folder import fill, require_countable, require_empty
from analysis.challenge.metric import Metric
from analysis.challenge.plant import AXES, nominal_model
from analysis.challenge.truth import Buried, Case, Number, Stratum
from campaigns.log import Channel, LogWriter
from campaigns.log.checksum import sidecar_of, write_sidecar
from sim_backend.errors import ConfigError
from sim_backend.model import dump_model
from sim_backend.safe_write import write_text

Array = NDArray[np.float64]

_EPOCH = datetime(2026, 1, 1, tzinfo=UTC)
"""Every case begins at this time: a clock would tell in which order and how fast cases were made."""


@dataclass(frozen=True)
class Counts:
    """How many cases of each stratum; `one`, `faint` and `outside` are per family."""

    one: int = 1
    faint: int = 0
    two: int = 0
    none: int = 1
    outside: int = 0


def plans_of(counts: Counts, families: Sequence[str], rng: np.random.Generator, shape: str | None = None) -> list[Plan]:
    """Return what every case is to be, in random order.

    Pairs and families left out of the search are of those without a twin. Raises ConfigError when no pair can be had.
    """
    # at least so many: which families have no twin takes most of a minute to tell
    require_countable(counts.none + counts.two + counts.outside + (counts.one + counts.faint) * len(families))
    alone = separable(families, rng) if counts.outside or counts.two else ()
    strata: list[tuple[Stratum, int, Sequence[str]]] = [
        ("one", counts.one, families),
        ("faint", counts.faint, families),
        ("outside", counts.outside, alone),
    ]
    require_countable(counts.none + counts.two + sum(n * len(some) for _, n, some in strata))
    plans = [Plan("none", (), shape)] * counts.none
    plans += [Plan(stratum, (slug,), shape) for stratum, n, some in strata for slug in some for _ in range(n)]
    if counts.two and len(alone) < 2:
        raise ConfigError(f"two effects at once need two families without a twin, there is {len(alone)}: name more")
    for _ in range(counts.two):
        pair = rng.choice(len(alone), 2, replace=False)
        plans.append(Plan("two", (alone[pair[0]], alone[pair[1]]), shape))
    return [plans[i] for i in rng.permutation(len(plans))]


def make_challenge(
    folder: Path,
    counts: Counts,
    *,
    seed: int,
    families: Sequence[str] = (),
    shape: str | None = None,
    jobs: int = 1,
    report: Callable[[float, float, str], None] = lambda done, total, what: None,
) -> str:
    """Write a challenge into `folder` (which must be new or empty) and return the hash of its truth.

    Raises ConfigError for an unknown family, no case at all, or a folder that holds something.
    """
    for family in families:
        members(family)
    require_empty(folder)
    plans = plans_of(counts, tuple(families) or slugs(), np.random.default_rng([seed, 0]), shape)
    return fill(folder, plans, make_case, seed=seed, jobs=jobs, report=report, public={})


def make_case(folder: Path, plan: Plan, seed: int, index: int) -> Case:
    """Draw one case, write its logs and nominal model into `folder`, and return its truth."""
    rng = np.random.default_rng([seed, 2, index])
    drawn = draw_case(plan, rng)
    campaign = drawn.campaign
    readings = campaign.readings((*drawn.parasites, *drawn.hidden), campaign.noise())
    for run, reading in zip(campaign.runs, readings, strict=True):
        write_run(folder / f"{run.name}.h5", folder.name, run, reading, rng)
    model = nominal_model(campaign.plant, rng, campaign.runs[0].excitation.rate_hz)
    write_text(folder / "nominal.toml", dump_model(model))
    for path in folder.iterdir():
        os.utime(path, (_EPOCH.timestamp(),) * 2)
    return _truth(drawn, readings)


def write_run(path: Path, case: str, run: Run, reading: Array, rng: np.random.Generator) -> None:
    """Write one run, its `reading` (n, axes) in rad, as a log that tells nothing but what was played and read.

    Its clock is the bench's: it begins at a fixed time and ends by its length, whenever it was computed. The
    temperature is read with noise of 1 mK.
    """
    n, axes = reading.shape
    excitation = run.excitation
    rate = excitation.rate_hz
    units = {"command": "N m", "position": "rad"}
    channels = [Channel(f"command_{a}", units["command"], "input", a, rate) for a in AXES[:axes]]
    channels += [Channel(a, units["position"], "output", a, rate) for a in AXES[:axes]]
    channels.append(Channel("temperature", "K", "aux", "", rate))
    columns = {f"command_{a}": excitation.command[:, i] for i, a in enumerate(AXES[:axes])}
    columns |= {a: reading[:, i] for i, a in enumerate(AXES[:axes])}
    columns["temperature"] = excitation.temperature_k + 1e-3 * rng.standard_normal(n)
    bench = {"kind": "bench", "name": "challenge", "serial": case, "version": "1"}
    with LogWriter.create(
        path,
        channels,
        test="free-run",
        bench=bench,
        seed=int(rng.integers(2**31)),
        run_uid=rng.bytes(16).hex(),
        started_utc=_EPOCH.isoformat(timespec="milliseconds"),
    ) as log:
        at = 0
        for stretch in run.stretches:
            with log.segment(stretch.label, stretch.settings):
                log.append({k: v[at : at + stretch.n] for k, v in columns.items()})
            at += stretch.n
    ended = _EPOCH + timedelta(seconds=n / rate)
    sidecar_of(path).unlink()
    with h5py.File(path, "r+") as file:
        file.attrs.modify("ended_utc", ended.isoformat(timespec="milliseconds"))
    write_sidecar(path)


def _truth(drawn: Drawn, readings: list[Array]) -> Case:
    campaign, hidden = drawn.campaign, drawn.hidden
    deviations = bound_deviations(Metric.of(campaign, beside=hidden), hidden)
    buried = [
        Buried(
            effect=effect.slug,
            where=effect.where,
            parameters={k: Number(value=v, bound_std=bound.get(k)) for k, v in effect.truth().items()},
            size=effect.size,
            detection_limit=limits.detection,
            naming_limit=limits.naming,
            rival=limits.rival,
            twins=list(limits.twins),
        )
        for effect, limits, bound in zip(hidden, drawn.limits, deviations, strict=True)
    ]
    return Case(
        stratum=drawn.plan.stratum,
        effects=buried,
        held_out_floor=held_out_floor(campaign, hidden, readings),
        shape=drawn.shape,
        axes=campaign.plant.n_axes,
    )
