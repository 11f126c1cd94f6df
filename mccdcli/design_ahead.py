"""A controller designed in a process of its own from a campaign's first runs, while its others play.

Playing keeps one core busy, and a design another; on a new installation, where each also compiles its kernels, they
would otherwise take twice as long one after the other.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from typing import IO, Self

    from campaigns.playing.campaign import Campaign
    from campaigns.playing.campaign_run import RunState

_CHILD = "from mccdcli.design_ahead import design; design()"


class DesignAhead:
    """Designs into the folder `out` as soon as every run is complete that `design_from_logs` would choose from.

    It writes what that would write after the campaign. Where it fails no controller is written, and the later design
    says why. What it began ends with the `with` block.
    """

    def __init__(self, campaign: Campaign, bench: str, seed: int, out: Path) -> None:
        self._campaign, self._bench, self._seed, self._out = campaign, bench, seed, out
        self.process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()

    @cached_property
    def _needed(self) -> frozenset[str]:
        """The runs that a design chooses from; none where none is made, or would not gain by being made now."""
        from analysis.design.from_logs import is_source
        from campaigns.benches import bench_kind
        from campaigns.playing.side_by_side import free_cores
        from campaigns.strategies.controller import FILE_NAME

        plans = self._campaign.plans()
        needed = frozenset(name for name, plan in plans.items() if is_source(plan.name, plan.settings()))
        enough = {"rest", "sinesweep"} <= {plans[name].name for name in needed}
        alone = not bench_kind(self._bench)[0].many or free_cores() < 2
        return frozenset() if alone or not enough or (self._out / FILE_NAME).exists() else needed

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process is not None:
            self.process.terminate()
            with self.process:  # closes the pipes
                pass

    def begin(self, states: Mapping[str, RunState]) -> None:
        """Begin, if that was not done yet, where all runs that are needed are complete; any thread may call."""
        with self._lock:
            if self._needed and not self.process and all(states[name].status == "complete" for name in self._needed):
                with suppress(OSError):  # a machine that can begin no process loses no time, and no campaign
                    self._begin(sorted(states[name].log for name in self._needed))

    def _begin(self, logs: Sequence[Path]) -> None:
        from campaigns.benches import open_bench
        from campaigns.log.child import start_python

        with closing(open_bench(self._bench, self._seed)) as opened:
            order = pickle.dumps((logs, opened.limits, opened.axes, self._out))
        self.process = start_python(_CHILD, talk=True)
        with suppress(BrokenPipeError), cast("IO[bytes]", self.process.stdin) as child:
            child.write(order)

    def finish(self) -> None:
        """Wait for the end of what was begun."""
        if self.process is not None:
            self.process.wait()


def design() -> None:
    """Design as the process that began this one asks: it sends logs, limits, axes and the folder."""
    from analysis.design.from_logs import design_from_logs
    from campaigns.log import read_run
    from mccdcli.freed_memory import keep_freed_memory

    keep_freed_memory()
    logs, limits, axes, out = pickle.load(sys.stdin.buffer)  # noqa: S301 only who began this process can send
    design_from_logs([read_run(log) for log in logs], limits, axes, out)
