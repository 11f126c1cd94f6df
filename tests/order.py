"""In which order tests run, and which of them stay together on one worker: what takes longest begins first.

The tests of a file stay together, for they share what is made once for the file. Files that take long and share
nothing are split into their tests. Which ones these are, and how long they take, stands in `durations.json`, which
`make durations` writes anew; a test that is not in there yet counts as short.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from xdist.scheduler.loadscope import LoadScopeScheduling

DURATIONS = Path(__file__).with_name("durations.json")

LONG_FILE_S = 10.0
"""Files that take longer are split, if their tests share nothing."""

WORTH_TELLING_S = 1.0
"""Shorter ones need not stand in the file."""

SHARES = "shares"
"""Name of the property that a report carries of a test that uses something made once for several tests."""

BUILT_IN = {"tmp_path_factory", "pytestconfig", "record_testsuite_property"}
"""Fixtures of a session that cost nothing to have on each worker."""


def expected() -> dict[str, float]:
    """Return the seconds that groups of tests took: a file, or a single test of a file that is split."""
    return json.loads(DURATIONS.read_text(encoding="utf-8")) if DURATIONS.exists() else {}


def group_of(nodeid: str, seconds: dict[str, float]) -> str:
    """Return the group of a test."""
    return nodeid if nodeid in seconds else nodeid.partition("::")[0]


class LongestFirst(LoadScopeScheduling):  # type: ignore[misc]
    """Hands the groups to the workers in the order of the collection, which `pytest_collection_modifyitems` made."""

    def __init__(self, config: pytest.Config, log: Any = None) -> None:
        super().__init__(config, log)
        config.option.loadscopereorder = False
        self._seconds = expected()

    def _split_scope(self, nodeid: str) -> str:
        return group_of(nodeid, self._seconds)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LongestFirst:
    """Let pytest-xdist hand out the groups."""
    return LongestFirst(config, log)


def pytest_xdist_auto_num_workers() -> int:
    """Return two workers more than there are processors.

    With one more, two processors had nothing to do for 28 % of a run: tests wait for lines, disks and browsers.
    """
    return (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1) + 2


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that writes the durations of this run down."""
    parser.addoption("--write-durations", action="store_true", help=f"Write tests/{DURATIONS.name} anew.")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the groups that take longest first; within a group, and among short ones, the order stays."""
    seconds = expected()
    items.sort(key=lambda item: -seconds.get(group_of(item.nodeid, seconds), 0.0))
    for item in items:
        if _shares(item):
            item.user_properties.append((SHARES, True))


def _shares(item: pytest.Item) -> bool:
    """Tell whether a test uses something that is made once for several tests."""
    found = getattr(item, "_fixtureinfo", None)
    definitions = found.name2fixturedefs if found else {}
    return any(made[-1].scope != "function" for name, made in definitions.items() if name not in BUILT_IN)


class Stopwatch:
    """Adds up what every test took, and writes it down at the end."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = defaultdict(float)
        self._sharing: set[str] = set()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add one part of a test."""
        self._seconds[report.nodeid] += report.duration
        if (SHARES, True) in report.user_properties:
            self._sharing.add(report.nodeid.partition("::")[0])

    def pytest_sessionfinish(self) -> None:
        """Write the groups that are worth telling, longest first."""
        files: dict[str, float] = defaultdict(float)
        for nodeid, took in self._seconds.items():
            files[nodeid.partition("::")[0]] += took
        split = {file for file, took in files.items() if took > LONG_FILE_S and file not in self._sharing}
        groups = {file: took for file, took in files.items() if file not in split and took >= WORTH_TELLING_S}
        groups |= {nodeid: took for nodeid, took in self._seconds.items() if nodeid.partition("::")[0] in split}
        not_run = {name: took for name, took in expected().items() if name not in files and name not in self._seconds}
        groups = {**not_run, **groups}
        ordered = sorted(groups.items(), key=lambda item: -item[1])
        text = json.dumps({name: round(took, 1) for name, took in ordered}, indent=0, ensure_ascii=False)
        DURATIONS.write_text(text + "\n", encoding="utf-8")


def pytest_configure(config: pytest.Config) -> None:
    """Take the time of the tests where that is asked for, in the process that sees all of them."""
    if config.getoption("--write-durations") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Stopwatch())
