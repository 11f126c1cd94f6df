"""Where a contender spends its time within this process: the functions with the most time of their own."""

from __future__ import annotations

import cProfile
import gc
import pstats
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core.dispatcher import Dispatcher

LINES, LEAST, ENOUGH_S = 12, 0.01, 1.0
"""Functions that are told at most, the share of the time from which one is told, and for how long runs are repeated."""
NUMBA, C, PYTHON = "compiled by numba", "C", "Python, with compiled code that it calls by pointer and array arithmetic"


def profile(run: Callable[[], Any]) -> list[str]:
    """Return shares by kind of code, then functions by own time, the longest first.

    Repeated for a second, so that work of milliseconds is told to the per mille. Numba tells the profiler of its calls;
    operators on arrays and calls through an address count as the function they stand in.
    """
    watched, turns, started = cProfile.Profile(), 0, time.perf_counter()
    while turns == 0 or time.perf_counter() - started < ENOUGH_S:
        watched.runcall(run)
        turns += 1
    entries: dict[tuple[str, int, str], Any] = pstats.Stats(watched).stats  # type: ignore[attr-defined]
    compiled = _compiled()
    total = sum(own for _, _, own, _, _ in entries.values()) or 1.0
    kinds = dict.fromkeys((NUMBA, C, PYTHON), 0.0)
    lines: list[str] = []
    for place, (_, calls, own, _, _) in sorted(entries.items(), key=lambda item: -item[1][2]):
        kind = _kind(place, compiled)
        kinds[kind] += own
        if len(lines) < LINES and own >= LEAST * total:
            what = f"{own / turns:.3g} s in {calls / turns:g} calls of {_name(place)}"
            lines.append(f"{100.0 * own / total:.1f} %, {what}" + (f", {kind}" if kind == NUMBA else ""))
    shares = ", ".join(f"{100.0 * own / total:.1f} % {kind}" for kind, own in kinds.items())
    return [f"{total / turns:.3g} s under the profiler: {shares}", *lines]


def _compiled() -> set[tuple[str, int, str]]:
    """Return file, first line and name of every function that numba has compiled in this process."""
    gc.unfreeze()  # what a process has frozen is in no list
    # by its own type: a weak reference to what is gone cannot be asked for another
    codes = [found.py_func.__code__ for found in gc.get_objects() if issubclass(type(found), Dispatcher)]
    return {(code.co_filename, code.co_firstlineno, code.co_name) for code in codes}


def _kind(place: tuple[str, int, str], compiled: set[tuple[str, int, str]]) -> str:
    if place in compiled:
        return NUMBA
    return C if place[0] == "~" else PYTHON


def _name(place: tuple[str, int, str]) -> str:
    file, line, name = place
    return name if file == "~" else f"{name} ({'/'.join(Path(file).parts[-2:])}:{line})"
