"""Trials that play one plan and measure its record: the settings of the trial are those of the plan."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from analysis.study.kinds.base import Kind, Scalar, Setup
from campaigns.plans import Plan, estimate, make_plan
from campaigns.playing.recording import Planned, Recording, play_in_memory
from sim_backend.simbench import SimBench


class PlayedTrial(Kind):
    """A subclass adds the `plan` and how its record is measured; `usual` are settings where its own defaults differ."""

    plan: ClassVar[str]
    usual: ClassVar[Mapping[str, Any]] = {}

    def __init__(self) -> None:
        self._planned = Planned()

    @abstractmethod
    def measured(self, record: Recording) -> Mapping[str, Scalar]:
        """Return the results by column."""

    def decides(self, setup: Setup) -> Mapping[str, Any]:
        """Return the plan's configuration, its design models included; raises ConfigError for what breaks a limit."""
        plan = self._plan(setup)
        estimate(plan, SimBench(setup.nominal, 0))
        return plan.configuration()

    def run(self, setup: Setup) -> Mapping[str, Scalar]:
        """Play the plan and measure it."""
        return self.measured(play_in_memory(self._plan(setup), SimBench(setup.bench, setup.seed), self._planned))

    def _plan(self, setup: Setup) -> Plan:
        return make_plan(self.plan, {**self.usual, **setup.settings})


@dataclass(frozen=True)
class _Header:
    test: str


class _Log(Recording):
    """A record in memory that also answers what a log does: its channels by role, and which test it is of."""

    @property
    def header(self) -> _Header:
        return _Header(self.path.name)

    def names(self, role: str) -> tuple[str, ...]:
        return tuple(name for name, channel in self.channels.items() if channel.role == role)


def as_log(record: Recording) -> Any:
    """Return a record for the measurements of recorded tests, which are typed for a `Run`.

    It is no `Run`, which holds an open file; they ask for nothing that is not here.
    """
    return _Log(record.path, record.rows, record.channels, record.segments, record.values)
