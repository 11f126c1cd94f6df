"""A kind of trial that does nothing, for `benchmarks.study_cost`: what is left is what a study takes for each trial.

A worker of a cluster knows it when it is started with `--preload benchmarks.study_nothing`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from analysis.study.kinds import KINDS, Column, Kind, Scalar, Setup


class NothingTrial(Kind):
    """Returns at once, with a number that tells trials apart."""

    name = "nothing"
    title = "nothing"
    columns = (Column("seed", "the seed of the trial"),)

    def decides(self, setup: Setup) -> Mapping[str, Any]:
        """Return that nothing decides it."""
        return {}

    def run(self, setup: Setup) -> Mapping[str, Scalar]:
        """Return the seed."""
        return {"seed": float(setup.seed)}


def dask_setup(_worker: object = None) -> None:
    """Make the trial known in this process; a worker calls this when it starts."""
    KINDS[NothingTrial.name] = NothingTrial()
