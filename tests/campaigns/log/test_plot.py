"""A log is drawn with its smallest and largest values, however many rows there are."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.log import Channel, LogWriter, read_run
from campaigns.log.plot import drawn, envelope, picture, save_picture
from sim_backend.errors import ConfigError, DataError


@pytest.fixture
def log(tmp_path):
    values = np.zeros(50_000)
    values[31_234], values[20_000] = 5.0, -3.0
    channels = [Channel("a", "V", "input", "x", 1e3), Channel("b", "rad", "output", "x", 1e3)]
    with LogWriter.create(tmp_path / "a.h5", channels, test="t", bench={"kind": "imported", "name": "n"}) as writer:
        for label, part in (("first", slice(0, 40_000)), ("held-out", slice(40_000, 50_000))):
            with writer.segment(label, {}):
                writer.append({"a": values[part], "b": values[part]})
    return tmp_path / "a.h5"


def test_a_single_peak_is_not_lost(log):
    values = np.zeros(50_000)
    values[31_234] = 5.0
    low, high = envelope(values, 1000)
    assert high.max() == 5.0 and low.size == 1000 and high.argmax() == 31_234 // 50
    with read_run(log) as run:
        (name, line, said), _ = drawn(run)
    assert name == "a" and line.index("█") == pytest.approx(31_234 / 50_000 * 60, abs=1.0) and said == "-3 to 5 V"


def test_the_picture_names_channels_units_and_segments(log, tmp_path):
    with read_run(log) as run:
        axes = picture(run).axes
        save_picture(run, tmp_path / "a.svg")
        for target, said in ((tmp_path / "a.svg", "not overwritten"), (tmp_path / "a.doc", "not a picture format")):
            with pytest.raises(ConfigError, match=said):
                save_picture(run, target)
    assert [ax.get_ylabel() for ax in axes] == ["a\n(V)", "b\n(rad)"] and axes[-1].get_xlabel() == "time (s)"
    assert [text.get_text() for text in axes[0].texts] == ["first", "held-out"]
    assert (tmp_path / "a.svg").read_text(encoding="utf-8").count("<svg") == 1


def test_a_log_without_rows_and_one_with_gaps(tmp_path):
    channels = [Channel("a", "V", "input", "x", 1e3)]
    with LogWriter.create(tmp_path / "empty.h5", channels, test="t", bench={"kind": "imported", "name": "n"}):
        pass
    with read_run(tmp_path / "empty.h5") as run, pytest.raises(DataError, match="nothing to draw"):
        drawn(run)
    with LogWriter.create(tmp_path / "gaps.h5", channels, test="t", bench={"kind": "imported", "name": "n"}) as log:
        log.append({"a": np.where(np.arange(300) % 3 == 0, np.nan, np.arange(300.0))})
    with read_run(tmp_path / "gaps.h5") as run:
        ((_, line, said),) = drawn(run)
    assert line[-1] == "█" and said == "1 to 299 V"


def test_a_picture_has_the_sign_of_a_degree_of_freedom_and_whole_numbers(tmp_path):
    channel = Channel("theta_x", "K", "output", "theta_x", 1e3)
    with LogWriter.create(tmp_path / "a.h5", [channel], test="t", bench={}) as writer, writer.segment("theta_x", {}):
        writer.append({"theta_x": 77.0 + 1e-5 * np.arange(100.0)})
    with read_run(tmp_path / "a.h5") as run:
        figure = picture(run)
    figure.canvas.draw()
    (axes,) = figure.axes
    assert axes.get_ylabel() == "θx\n(K)" and [text.get_text() for text in axes.texts] == ["θx"]
    assert axes.yaxis.get_offset_text().get_text() == ""
