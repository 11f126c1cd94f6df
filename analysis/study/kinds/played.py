"""Trials that play one plan and measure its record: the settings of the trial are those of the plan."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

from analysis.study.kinds.base import Kind, Scalar, Setup, attempted
from campaigns.plans import Plan, estimate, make_plan
from campaigns.playing.recording import Planned, Recording, joined
from sim_backend.bench import Record, Segment
from sim_backend.errors import ConfigError
from sim_backend.simbench import SimBench, play_side_by_side


@dataclass
class _Begun:
    """A trial under way: its bench, what it plays, and the records of what was played, or why there is none."""

    plan: Plan
    bench: SimBench
    segments: tuple[Segment, ...]
    records: list[Record] = field(default_factory=list)
    error: ConfigError | None = None


def _play(group: Sequence[_Begun]) -> None:
    """Play the segments, which are the same for all; a bench that cannot go on leaves the others to it."""
    for segment in group[0].segments:
        there = [one for one in group if one.error is None]
        for one, record in zip(there, play_side_by_side([one.bench for one in there], segment), strict=True):
            if isinstance(record, ConfigError):
                one.error = record
            else:
                one.records.append(record)


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
        (found,) = self.run_together([setup])
        if isinstance(found, Exception):
            raise found
        return found

    def run_together(self, setups: Sequence[Setup]) -> list[Mapping[str, Scalar] | Exception]:
        """Play the plan of each, those with the same segments side by side, and measure it."""
        found = attempted(partial(self._played, setups))
        if not isinstance(found, Exception):
            return found
        if len(setups) == 1:
            return [found]
        # an error that nobody foresaw: whoever met it keeps it to himself
        return [one for setup in setups for one in self.run_together([setup])]

    def _played(self, setups: Sequence[Setup]) -> list[Mapping[str, Scalar] | Exception]:
        begun = [attempted(partial(self._begun, setup)) for setup in setups]
        groups: dict[int, list[_Begun]] = {}
        for one in begun:
            if isinstance(one, _Begun):
                groups.setdefault(id(one.segments), []).append(one)
        for group in groups.values():
            _play(group)
        return [attempted(partial(self._found, one)) if isinstance(one, _Begun) else one for one in begun]

    def _begun(self, setup: Setup) -> _Begun:
        plan, bench = self._plan(setup), SimBench(setup.bench, setup.seed)
        return _Begun(plan, bench, self._planned.segments(plan, bench))

    def _found(self, one: _Begun) -> Mapping[str, Scalar]:
        if one.error is not None:
            raise one.error
        return self.measured(joined(one.plan, one.bench, one.segments, one.records))

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

    It is not a `Run`, which holds an open file; they ask for nothing that is not here.
    """
    return _Log(record.path, record.rows, record.channels, record.segments, record.values)
