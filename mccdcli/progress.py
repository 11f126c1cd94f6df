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


@contextmanager
def progress(title: str, *, timed: bool = True) -> Iterator[Report]:
    """Show the progress of one piece of work, with the time left where known; call what this yields as it advances.

    Without `timed` no time is shown: of a search that ends when nothing gets better nobody knows how much is left.
    Library code takes the callable as a plain argument, so it need not know of terminals. Nothing is written
    to standard output, and nothing at all for work that ends before its first line is due.
    """
    if sys.stderr.isatty() and os.environ.get("TERM") != "dumb":
        with _bar(title, timed=timed) as report:
            yield report
    else:
        yield _forward(_lines(title, timed=timed))


@contextmanager
def _bar(title: str, *, timed: bool) -> Iterator[Report]:
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn, TextColumn
    from rich.text import Text

    from campaigns.progress import TimeLeft

    left = TimeLeft(time.monotonic())

    class Left(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(_left(left.left_s(time.monotonic())), style="progress.remaining")

    percent = TaskProgressColumn("[progress.percentage]{task.percentage:>3.0f} %")
    columns = (TextColumn("{task.description}"), BarColumn(), percent, *((Left(),) if timed else ()))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:  # rich honours NO_COLOR
        task = bars.add_task(escape(title), total=None)

        def report(done: float, total: float, what: str = "") -> None:
            left.seen(done / total, time.monotonic())
            bars.update(task, completed=done, total=total, description=escape(f"{title} {what}".rstrip()))

        yield _forward(report)


def _left(left_s: float | None) -> str:
    """Return a time left as text, empty where it is not known."""
    if left_s is None:
        return ""
    return f"{left_s:.0f} s left" if left_s < 120.0 else f"{left_s / 60.0:.0f} min left"


def _forward(report: Report) -> Report:
    """Return a report that never goes back: work that is done again, such as another fit, stays counted."""
    furthest = 0.0

    def told(done: float, total: float, what: str = "") -> None:
        nonlocal furthest
        furthest = max(furthest, min(done / total, 1.0)) if total > 0.0 else furthest
        report(furthest, 1.0, what)

    return told


def _lines(title: str, clock: Callable[[], float] = time.monotonic, *, timed: bool = True) -> Report:
    from campaigns.progress import TimeLeft  # --help shows the progress of nothing

    left = TimeLeft(clock())
    due_s = clock() + LINE_PERIOD_S

    def report(done: float, total: float, what: str = "") -> None:
        nonlocal due_s
        now_s = clock()
        if total <= 0:
            return
        left.seen(done / total, now_s)
        if now_s < due_s:
            return
        due_s = now_s + LINE_PERIOD_S
        time_left = _left(left.left_s(now_s)) if timed else ""
        told = f"{100 * done / total:.0f} %" + (f" ({time_left})" if time_left else "")
        say(f"{title}: {told} {what}".rstrip())

    return report
