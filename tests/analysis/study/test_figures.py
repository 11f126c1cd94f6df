"""The figure of a study draws what its trials say: shares against counting, in the units that people read."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from analysis.pages.canvas import COLOURS
from analysis.study.figures import MOST_SERIES, study_figure
from analysis.study.store import Store
from analysis.study.summary import summarise
from analysis.study.trial import Job, Outcome
from tests.analysis.study.studies import spread

SIZES = '\n[[vary]]\nplace = "settings.to_rad"\nsweep = [1e-3, 2e-3, 8e-3]\n'


def drawn(folder: Path, job: Job, settling_s: Sequence[float | None]):
    """Return the points of the figure of a study in which trial `t` settled after `settling_s[t]`, None: it failed."""
    blank = (None,) * len(job.varied_names)
    outcomes = [
        Outcome(t, "failed", "unstable", blank, (None,) * 5, 0.1)
        if s is None
        else Outcome(t, "done", "", blank, (s, 1e-6, 0.1, 2.0, 1e-7), 0.1)
        for t, s in enumerate(settling_s)
    ]
    with Store(folder, {}, job.varied_names, job.columns, resume=False) as store:
        store.add(outcomes)
        canvas = study_figure(job, store, summarise(job, store))
    return canvas, canvas.numbers()


def test_without_a_sweep_of_numbers_it_shows_the_share_below_each_value(tmp_path: Path) -> None:
    # even trials are hybrid, odd ones mbff; of hybrid one failed and one never settles
    times = [0.02, 0.03, None, 0.01, math.inf, 0.02, 0.01, 0.04]
    canvas, points = drawn(tmp_path, Job.of(spread(4)), times)
    panel = points[points["x_quantity"] == "settling (ms)"]
    hybrid, mbff = (panel[panel["series"] == f"strategy {name}"] for name in ("hybrid", "mbff"))
    assert hybrid["x"].tolist() == pytest.approx([10.0, 20.0]) and hybrid["y"].tolist() == [0.25, 0.5]
    assert mbff["x"].tolist() == pytest.approx([10.0, 20.0, 30.0, 40.0]) and mbff["y"].tolist() == [
        0.25,
        0.5,
        0.75,
        1.0,
    ]
    # the limit of 5 ms is drawn; that of 10 A, far from 2 A, is written
    upright = [line.get_xdata() for line in canvas.axes[0].lines if len(set(line.get_xdata())) == 1]
    assert [x[0] for x in upright] == [5.0]
    assert canvas.axes[3].get_xlabel() == "peak_current_a, limit 10"
    assert "<svg" in canvas.svg("stamp")


def test_along_a_sweep_of_numbers_it_shows_medians(tmp_path: Path) -> None:
    job = Job.of(spread(3, SIZES))
    assert len(job.study.points) == 6
    rng = np.random.default_rng(0)
    times = rng.uniform(0.01, 0.02, (3, 6))
    _, points = drawn(tmp_path, job, times.reshape(-1).tolist())
    panel = points[points["y_quantity"] == "settling (ms)"]
    for s, name in enumerate(("hybrid", "mbff")):
        shown = panel[panel["series"] == f"strategy {name}"]
        assert shown["x"].tolist() == [1e-3, 2e-3, 8e-3]
        assert shown["y"].tolist() == pytest.approx(1e3 * np.median(times[:, 3 * s : 3 * s + 3], axis=0))


def swept(place: str, values: Sequence[float]) -> str:
    return f'\n[[vary]]\nplace = "settings.{place}"\nsweep = {list(values)}\n'


def looks(svg: str) -> set[tuple[str, str]]:
    """Return colour and dash of everything that is drawn in a colour and not filled."""
    styles = re.findall(r'style="(fill: none;[^"]*)"', svg)
    found = {tuple(re.sub(rf".*{key}: ([^;]*);.*|.*", r"\1", style + ";") for key in PAINT) for style in styles}
    return {(colour, dash) for colour, dash in found if colour in COLOURS}


PAINT = ("stroke", "stroke-dasharray")
WITH_LIMIT = 1
"""The limit is a look of its own: of the paper's colour, dashed."""


@pytest.mark.parametrize("along", [SIZES, ""], ids=["medians", "shares"])
def test_every_series_is_drawn_and_no_two_look_alike(along: str, tmp_path: Path) -> None:
    job = Job.of(spread(2, along + swept("cycles", [2, 3]) + swept("alpha_deg", [0.0, 90.0])))
    canvas, points = drawn(tmp_path, job, np.linspace(0.01, 0.02, job.study.total).tolist())
    assert points[points["panel"] == points["panel"][0]]["series"].nunique() == 8 > len(COLOURS)
    assert len(looks(canvas.svg())) == 8 + WITH_LIMIT


def test_series_that_are_too_many_are_counted(tmp_path: Path) -> None:
    job = Job.of(spread(2, SIZES + swept("cycles", range(2, 22))))
    canvas, points = drawn(tmp_path, job, np.linspace(0.01, 0.02, job.study.total).tolist())
    shown = points[points["panel"] == points["panel"][0]]["series"].nunique()
    svg = canvas.svg()
    assert shown == MOST_SERIES == len(looks(svg)) - WITH_LIMIT
    assert f"and {40 - MOST_SERIES} more, in study.json" in svg
