"""Progress of long work on standard error: a bar on a terminal, else a line now and then."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mccdcli.output import say

# report(done, total, what): how much of the work is done, in any unit, and what is being done now
Report = Callable[[float, float, str], None]

LINE_PERIOD_S = 5.0  # often enough to see that it lives, seldom enough for the log of a night's run

KNOWN_SHARE = 0.05
"""Share of the work before which nobody knows how long it takes: no time left is shown."""


@contextmanager
def progress(title: str) -> Iterator[Report]:
    """Show the progress of one piece of work, with the time left; call what this yields as the work advances.

    Library code takes the callable as a plain argument, so it need not know of terminals. Nothing is written
    to standard output, and nothing at all for work that ends before its first line is due.
    """
    if sys.stderr.isatty() and os.environ.get("TERM") != "dumb":
        with _bar(title) as report:
            yield report
    else:
        yield _forward(_lines(title))


@contextmanager
def _bar(title: str) -> Iterator[Report]:
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:  # rich honours NO_COLOR
        task = bars.add_task(escape(title), total=None)

        def report(done: float, total: float, what: str = "") -> None:
            bars.update(task, completed=done, total=total, description=escape(f"{title} {what}".rstrip()))

        yield _forward(report)


def _forward(report: Report) -> Report:
    """Return a report that never goes back: work that is done again, as a fit of another form, is no less done."""
    furthest = 0.0

    def told(done: float, total: float, what: str = "") -> None:
        nonlocal furthest
        furthest = max(furthest, min(done / total, 1.0)) if total > 0.0 else furthest
        report(furthest, 1.0, what)

    return told


def _lines(title: str, clock: Callable[[], float] = time.monotonic) -> Report:
    started_s = clock()
    due_s = started_s + LINE_PERIOD_S

    def report(done: float, total: float, what: str = "") -> None:
        nonlocal due_s
        now_s = clock()
        if now_s < due_s or total <= 0:
            return
        due_s = now_s + LINE_PERIOD_S
        share = done / total
        left = f", {(now_s - started_s) * (1.0 - share) / share:.0f} s left" if share >= KNOWN_SHARE else ""
        say(f"{title}: {100 * share:.0f} %{left} {what}".rstrip())

    return report
