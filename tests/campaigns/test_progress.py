"""Long work on logs tells how far it is: it begins near nothing, never goes back, and ends near the whole."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from campaigns.importing import import_run
from campaigns.log import Channel, LogWriter, read_run, recover, verify
from campaigns.log.export import FORMS, save
from campaigns.log.limits import BLOCK_ROWS
from campaigns.log.summary import summarise
from campaigns.progress import Report, TimeLeft, part_of
from tests.listening import Listener

ROWS = 5 * BLOCK_ROWS
MAP = """[log]
test = "x"
source = "data.npz"
sample_rate_hz = 1000.0
[channels.a]
select = "a"
unit = "N m"
role = "input"
[channels.b]
select = "b"
unit = "rad"
role = "output"
[segments]
one = [0, 100]
two = [100, 300]
"""


def long_log(folder: Path) -> None:
    rng = np.random.default_rng(0)
    channels = [Channel("a", "rad", "output", "x", 1000.0)]
    with LogWriter.create(
        folder / "run.h5", channels, test="x", bench={"kind": "sim", "name": "x"}, configuration="{}"
    ) as log:
        log.append({"a": rng.normal(size=ROWS)})


def verified(folder: Path, report: Report) -> None:
    long_log(folder)
    assert verify(folder / "run.h5", report).ok


def recovered(folder: Path, report: Report) -> None:
    long_log(folder)
    assert recover(folder / "run.h5", folder / "saved.h5", report).rows == ROWS


def imported(folder: Path, report: Report) -> None:
    rng = np.random.default_rng(0)
    (folder / "map.toml").write_text(MAP)
    np.savez(folder / "data.npz", a=rng.normal(size=300), b=rng.normal(size=300))
    assert import_run(folder / "map.toml", folder / "run.h5", report).rows == 300


def exported(form: str) -> Callable[[Path, Report], None]:
    def work(folder: Path, report: Report) -> None:
        long_log(folder)
        with read_run(folder / "run.h5") as run:
            save(run, folder / f"run{form}", report)

    return work


def summarised(folder: Path, report: Report) -> None:
    long_log(folder)
    with read_run(folder / "run.h5") as run:
        assert summarise(run, report=report)[0].rows == ROWS


@pytest.mark.parametrize("work", [summarised, verified, recovered, imported, *map(exported, FORMS)])
def test_what_takes_long_tells_how_far_it_is(work: Callable[[Path, Report], None], tmp_path: Path) -> None:
    heard = Listener()
    work(tmp_path, heard)
    assert len(heard.shares) >= 4 and all(heard.said)
    assert heard.shares == sorted(heard.shares)
    # none but the last step is left when it was last heard
    assert heard.shares[0] < 0.2 and 0.7 < heard.shares[-1] <= 1.0


def test_a_part_of_the_work_counts_as_its_share() -> None:
    heard = Listener()
    told = part_of(part_of(heard, 0.5, 1.0), 0.0, 0.5)
    told(1.0, 4.0, "a")
    told(0.0, 0.0, "of nothing")
    assert heard.shares == [0.5 + 0.5 * 0.125, 0.5] and heard.said == ["a", "of nothing"]


def shares(kind: str, n: int = 1000) -> list[tuple[float, float]]:
    """Moments and shares of a work of 100 s that goes on in steps of a kind."""
    at = [(100.0 * k / n, k / n) for k in range(1, n + 1)]
    if kind == "slower":  # the second half takes nine tenths of the time
        return [(t, 5.0 * t / 100.0 if t < 10.0 else 0.5 + 0.5 * (t - 10.0) / 90.0) for t, _ in at]
    if kind == "faster":
        return [(t, 0.5 * t / 90.0 if t < 90.0 else 0.5 + 0.5 * (t - 90.0) / 10.0) for t, _ in at]
    if kind == "uneven":  # 20 steps, each other one three times as long
        ends = [sum(2.5 if k % 2 else 7.5 for k in range(m)) for m in range(1, 21)]
        return [(end, (m + 1) / 20) for m, end in enumerate(ends)]
    return at


@pytest.mark.parametrize("kind", ["even", "uneven"])
def test_of_steady_work_the_time_left_is_told_within_a_factor_of_two(kind: str) -> None:
    left, told = TimeLeft(0.0), 0
    for at_s, share in shares(kind):
        left.seen(share, at_s)
        found = left.left_s(at_s)
        if found is not None and at_s < 99.0:
            told += 1
            assert 0.5 * (100.0 - at_s) <= found <= 2.0 * (100.0 - at_s), (at_s, found)
    assert told > 0.5 * len(shares(kind))


@pytest.mark.parametrize("kind", ["slower", "faster"])
def test_soon_after_a_change_of_pace_no_wrong_time_is_told(kind: str) -> None:
    # "soon": a change is seen when it has lasted for a tenth of the time gone by
    left, change = TimeLeft(0.0), 11.0 if kind == "slower" else 92.0
    for at_s, share in shares(kind):
        left.seen(share, at_s)
        found = left.left_s(at_s)
        if found is not None and change < at_s < 99.9:
            assert 0.5 * (100.0 - at_s) <= found <= 2.0 * (100.0 - at_s), (at_s, found)


def test_work_that_stands_still_tells_no_time() -> None:
    left = TimeLeft(0.0)
    for k in range(1, 51):
        left.seen(k / 100, float(k))
    assert left.left_s(50.0) == pytest.approx(50.0)
    assert left.left_s(60.0) is None and left.left_s(100.0) is None
