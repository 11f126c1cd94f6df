"""The figure of the measured response and those of the models, against closed forms."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from analysis.diagnosis.answer.figures import bode_figure
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from tests.analysis.diagnosis.answer.test_mechanism import DECAY, HZ, NOISE_RAD, RATE_HZ, answer, axis, diagnosed, drawn


def test_the_response_is_that_of_the_transfer_function():
    found, *_ = diagnosed("cubic-stiffness")
    rng = np.random.default_rng(1)
    u = rng.standard_normal(60_000)
    y = answer(u) + NOISE_RAD * rng.standard_normal(u.size)
    record = Record("uid", u[:, None], y[:, None], (Window("all", 0, u.size),))
    found = dataclasses.replace(found, data=Dataset(RATE_HZ, (record,)))
    figure = bode_figure(found, axis(), 0)
    assert figure is not None
    f, size, *_ = drawn(figure.canvas, "measured")
    f, size = f[: f.size // 3], size[: size.size // 3]  # magnitude, phase, ratio
    s = 2j * np.pi * f
    square = (2.0 * np.pi * HZ) ** 2
    closed = np.abs(square / (s**2 + 2.0 * DECAY * s + square))
    low = (f > 1.0) & (f < 0.1 * RATE_HZ)  # where the hold changes the size by less than 2 %
    assert low.sum() > 50
    assert np.median(size[low] / closed[low]) == pytest.approx(1.0, rel=0.02)
    assert size[low] == pytest.approx(closed[low], rel=0.15)
    numbers = figure.canvas.numbers()
    ratio = numbers[(numbers.series == "measured") & (numbers.panel == "panel 3")].y.to_numpy()
    # what is measured is what the model as given answers
    assert np.median(ratio) == pytest.approx(1.0, rel=0.02)


def test_adjusted_numbers_are_seen_in_the_response_over_the_one_as_given():
    found, *_ = diagnosed("cubic-stiffness")
    half = found.nominal.with_(b=0.5 * found.nominal.b)
    figure = bode_figure(dataclasses.replace(found, adjusted=half), axis(), 0)
    assert figure is not None
    numbers = figure.canvas.numbers()
    ratio = {name: rows.y.to_numpy() for name, rows in numbers[numbers.panel == "panel 3"].groupby("series")}
    assert ratio["adjusted"] == pytest.approx(0.5) and ratio["as given"] == pytest.approx(1.0)


def test_an_input_that_never_moves_gives_no_response():
    found, *_ = diagnosed("cubic-stiffness")
    record = found.data.records[0]
    still = dataclasses.replace(record, u=np.zeros_like(record.u))
    assert bode_figure(dataclasses.replace(found, data=Dataset(RATE_HZ, (still,))), axis(), 0) is None
