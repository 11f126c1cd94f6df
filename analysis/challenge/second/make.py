"""Make a challenge by the second generator: which laws, how many cases, and one case from its draw to its files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.folder import Report, fill, require_countable, require_empty
from analysis.challenge.second.draw import Drawn, Plan, draw_case
from analysis.challenge.second.integrate import Placed
from analysis.challenge.second.laws import LAWS
from analysis.challenge.second.limits import Limits
from analysis.challenge.second.plant import NOMINAL_ERROR, nominal_text
from analysis.challenge.second.reserve import unlisted
from analysis.challenge.second.write import EPOCH, channels_of, columns_of, write_exact, write_text
from analysis.challenge.truth import Buried, Case, Number, Stratum
from sim_backend import safe_write
from sim_backend.errors import ConfigError, did_you_mean

Array = NDArray[np.float64]

_READINGS = ("exact", "text", "counts")

COUNT = (0.05, 0.3)
"""Size of a count in standard deviations of the noise: a fact of the record, below what matters."""


@dataclass(frozen=True)
class Counts:
    """How many cases: `none` and `two` in all, `one` and `outside` per listed law, the others per law of theirs."""

    none: int = 1
    one: int = 1
    two: int = 0
    outside: int = 0
    twisted: int = 0
    unlisted: int = 0


def plans_of(counts: Counts, names: Sequence[str], rng: np.random.Generator, *, kept_back: bool = False) -> list[Plan]:
    """Return what every case is to be, in random order; `names` (of laws or causes) leave out all others.

    With `kept_back` unlisted laws are the reserved ones, else the others. Raises ConfigError for an unknown name and
    where a pair is asked for that cannot be had.
    """
    known = {word for law in LAWS.values() if law.group != "unlisted" for word in (law.name, law.effect)}
    known |= set(unlisted(kept_back=kept_back))
    for name in names:
        if name not in known:
            raise ConfigError(f"the second generator has no law '{name}'. {did_you_mean(name, sorted(known))}".rstrip())
    chosen = [law for law in LAWS.values() if not names or law.name in names or law.effect in names]
    listed = [law.name for law in chosen if law.group == "listed"]
    alone = [law.name for law in chosen if law.group == "listed" and law.alone]
    outside = {law.name for law in chosen if law.group == "unlisted"} & set(unlisted(kept_back=kept_back))
    groups: list[tuple[Stratum, int, Sequence[str]]] = [
        ("one", counts.one, listed),
        ("outside", counts.outside, alone),
        ("twisted", counts.twisted, [law.name for law in chosen if law.group == "twisted"]),
        ("unlisted", counts.unlisted, sorted(outside)),
    ]
    require_countable(counts.none + counts.two + sum(n * len(some) for _, n, some in groups))
    plans = [Plan("none")] * counts.none
    plans += [Plan(stratum, (name,)) for stratum, n, some in groups for name in some for _ in range(n)]
    if counts.two and len({LAWS[name].effect for name in alone}) < 2:
        raise ConfigError(f"pairs need two listed causes without a twin, there is {len(alone)} law: name more")
    while sum(plan.stratum == "two" for plan in plans) < counts.two:
        first, second = (alone[i] for i in rng.choice(len(alone), 2, replace=False))
        if LAWS[first].effect != LAWS[second].effect:
            plans.append(Plan("two", (first, second)))
    return [plans[i] for i in rng.permutation(len(plans))]


def make_challenge(
    folder: Path,
    counts: Counts,
    *,
    seed: int,
    names: Sequence[str] = (),
    kept_back: bool = False,
    jobs: int = 1,
    report: Report = lambda done, total, what: None,
) -> str:
    """Write a challenge into `folder` (which must be new or empty) and return the hash of its truth.

    Raises ConfigError for an unknown law, no case at all, or a folder that holds something.
    """
    require_empty(folder)
    plans = plans_of(counts, names, np.random.default_rng([seed, 0]), kept_back=kept_back)
    public = {"generator": "second", "nominal_error": NOMINAL_ERROR}
    return fill(folder, plans, make_case, seed=seed, jobs=jobs, report=report, public=public)


def make_case(folder: Path, plan: Plan, seed: int, index: int) -> Case:
    """Draw one case, write its logs and nominal model into `folder`, and return its truth."""
    rng = np.random.default_rng([seed, 2, index])
    drawn = draw_case(plan, rng)
    campaign, plant = drawn.campaign, drawn.campaign.plant
    kind, digits = str(rng.choice(_READINGS)), int(rng.integers(6, 11))
    counts = {d: x.std * rng.uniform(*COUNT) for d, x in zip(plant.names, campaign.noises, strict=True)}
    warm = rng.random() < 0.5 or any(x.law.effect == "thermal-stiffness-drift" for x in drawn.hidden)
    channels, readings = channels_of(campaign, warm), []
    for number, (record, motion) in enumerate(zip(campaign.records, drawn.motions, strict=True)):
        readings.append(motion.reading + campaign.noise[number])
        time = np.arange(record.n) / campaign.rate_hz
        wave = campaign.kelvin * np.sin(2.0 * np.pi * campaign.kelvin_hz * time)
        temperature = 77.0 + wave + 1e-3 * rng.standard_normal(record.n) if warm else None
        columns = columns_of(campaign, record, motion.command, readings[-1], temperature)
        path = folder / f"run-{number + 1}.h5"
        if kind == "exact":
            write_exact(path, channels, record, columns, rng)
        else:
            used = counts if kind == "counts" else {}
            write_text(path, channels, record, columns, rng, digits=max(digits, 9) if used else digits, counts=used)
    safe_write.write_text(folder / "nominal.toml", nominal_text(plant, rng, campaign.rate_hz))
    for path in folder.iterdir():
        os.utime(path, (EPOCH.timestamp(),) * 2)
    return _truth(drawn, kind, readings)


def _truth(drawn: Drawn, kind: str, readings: list[Array]) -> Case:
    campaign = drawn.campaign
    names = campaign.plant.names
    return Case(
        stratum=drawn.plan.stratum,
        effects=[_buried(one, limit, names) for one, limit in zip(drawn.hidden, drawn.limits, strict=True)],
        held_out_floor=_floor(drawn, readings),
        shape=campaign.traits["waveform"],
        axes=len(names),
        traits={
            **campaign.traits,
            "readings": kind,
            "noise": "/".join(sorted({x.slope for x in campaign.noises})),
        },
        granted=[("sensor-quantisation", d) for d in names] if kind == "counts" else [],
        noise_rms=[float(x.std) for x in campaign.noises],
        redrawn=drawn.redrawn,
    )


def _buried(one: Placed, limit: Limits, names: Sequence[str]) -> Buried:
    law = one.law
    crossed = law.effect in ("cross-coupling", "sensor-rotation")
    where = f"{names[one.j]}->{names[one.i]}" if crossed else names[one.i]
    size = float(one.p[0])
    return Buried(
        effect=law.effect,
        where=where,
        parameters={law.parameter: Number(value=size)} if law.parameter and law.group == "listed" else {},
        size=size,
        detection_limit=float(limit.detection),
        naming_limit=float(limit.naming),
        rival=limit.rival,
        twins=[(name, where) for name in limit.twins],
        law=law.name,
    )


def _floor(drawn: Drawn, readings: list[Array]) -> float:
    """Return the held-out error of the true laws with the true numbers: noise over reading, rms over the outputs."""
    rows = [~record.mask() for record in drawn.campaign.records]
    noise = np.vstack([x[r] for x, r in zip(drawn.campaign.noise, rows, strict=True)])
    reading = np.vstack([x[r] for x, r in zip(readings, rows, strict=True)])
    return float(np.sqrt(np.mean(np.mean(noise**2, axis=0) / np.mean(reading**2, axis=0))))
