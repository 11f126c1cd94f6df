"""Trials that play one plan and measure its record: the settings of the trial are those of the plan."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from analysis.study.kinds.base import Kind, Scalar, Setup
from campaigns.plans import estimate, make_plan
from campaigns.playing.recording import Planned, Recording, play_in_memory
from sim_backend.simbench import SimBench


class PlayedTrial(Kind):
    """A subclass adds the `plan` and how its record is measured."""

    plan: ClassVar[str]

    def __init__(self) -> None:
        self._planned = Planned()

    @abstractmethod
    def measured(self, record: Recording) -> Mapping[str, Scalar]:
        """Return the results by column."""

    def decides(self, setup: Setup) -> Mapping[str, Any]:
        """Return the plan's configuration, its design models included; raises ConfigError for what breaks a limit."""
        plan = make_plan(self.plan, dict(setup.settings))
        estimate(plan, SimBench(setup.nominal, 0))
        return plan.configuration()

    def run(self, setup: Setup) -> Mapping[str, Scalar]:
        """Play the plan and measure it."""
        plan = make_plan(self.plan, dict(setup.settings))
        return self.measured(play_in_memory(plan, SimBench(setup.bench, setup.seed), self._planned))
