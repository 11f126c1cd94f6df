"""A challenge on disk: its cases made one by one or several at a time, then the sealed truth and the public list."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from analysis.challenge.truth import Case, Truth, seal
from sim_backend.errors import ConfigError
from sim_backend.safe_write import write_text

Plan = TypeVar("Plan")
Maker = Callable[[Path, Plan, int, int], Case]
"""Writes one case (its folder, plan, the challenge's seed, its number) and returns its truth."""

Report = Callable[[float, float, str], None]


def require_empty(folder: Path) -> None:
    """Raise ConfigError when `folder` holds something."""
    if folder.exists() and any(folder.iterdir()):
        raise ConfigError(f"{folder} is not empty and a challenge never overwrites: choose another folder")


MOST_CASES = 100_000
"""Cases of a challenge: a second and a megabyte or more for each."""


def require_countable(cases: int) -> None:
    """Raise ConfigError for more cases than a challenge may have, before any is planned."""
    if cases > MOST_CASES:
        raise ConfigError(
            f"the challenge would have {cases:.4g} cases, {cases / 3600:.3g} h and {cases / 1e3:.3g} GB or more; the "
            f"limit is {MOST_CASES}: ask for fewer, or make several with other seeds"
        )


def fill(
    folder: Path,
    plans: Sequence[Plan],
    maker: Maker[Plan],
    *,
    seed: int,
    jobs: int,
    report: Report,
    public: Mapping[str, Any],
) -> str:
    """Make every case, seal the truth, write `challenge.json` with `public` besides; return the hash of the truth.

    Raises ConfigError for no case at all.
    """
    if not plans:
        raise ConfigError("a challenge of no cases: ask for at least one case of some stratum")
    names = [f"{i + 1:04d}" for i in range(len(plans))]
    for name in names:
        (folder / "cases" / name).mkdir(parents=True)
    truths: dict[str, Case] = {}
    work = [(folder / "cases" / name, plan, seed, i) for i, (name, plan) in enumerate(zip(names, plans, strict=True))]
    for done, (name, case) in enumerate(_made(work, maker, jobs), start=1):
        truths[name] = case
        report(done, len(plans), f"case {name}")
    salt = np.random.default_rng([seed, 1]).bytes(16).hex()
    digest = seal(folder, Truth(seed=seed, salt=salt, cases=dict(sorted(truths.items()))))
    listed = {"schema": "mccd-challenge/1", "cases": names, "seal": digest, **public}
    write_text(folder / "challenge.json", json.dumps(listed, indent=1) + "\n")
    return digest


def _made(work: list[tuple[Path, Plan, int, int]], maker: Maker[Plan], jobs: int) -> Iterator[tuple[str, Case]]:
    if jobs == 1:
        yield from ((item[0].name, maker(*item)) for item in work)
        return
    with ProcessPoolExecutor(jobs) as pool:
        waiting = {pool.submit(maker, *item): item[0].name for item in work}
        for future in as_completed(waiting):
            yield waiting[future], future.result()
