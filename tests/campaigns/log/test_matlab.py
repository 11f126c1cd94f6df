"""A MATLAB file that is written piece by piece is, byte for byte, the one that scipy writes at once."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from campaigns.log.matlab import Numbers, write_structure

HEADER = 128
"""Bytes in front of the first matrix: they hold the time of writing."""
COLUMN = np.random.default_rng(0).normal(size=(1001, 1))
TEXTS = ["", "a", "N m", "four", "N m/rad", "θ in µrad 😀", "a\nb"]
LONG = "x" * 63


def written(fields):
    file = BytesIO()
    write_structure(file, "run", fields)
    return file.getvalue()


def by_scipy(fields):
    file = BytesIO()
    savemat(file, {"run": fields}, long_field_names=True, oned_as="column")
    return file.getvalue()


@pytest.mark.parametrize(("ours", "scipys"), [
    *(({"text": t}, {"text": t}) for t in TEXTS),
    ({"a": TEXTS}, {"a": np.array(TEXTS, dtype=object)}),
    ({"none": []}, {"none": np.array([], dtype=object)}),
    ({LONG: "1", "b": "2"}, {LONG: "1", "b": "2"}),
    ({"x": Numbers((1001, 1), [COLUMN[:400, 0], COLUMN[400:, 0]])}, {"x": COLUMN}),
    ({"x": Numbers((0, 1), []), "y": Numbers((0, 0), [])}, {"x": np.zeros((0, 1)), "y": np.zeros((0, 0))}),
    ({"a": {"b": {"c": "deep"}, "d": Numbers((1, 1), [np.ones(1)])}}, {"a": {"b": {"c": "deep"}, "d": np.ones(1)}}),
])  # fmt: skip
def test_every_kind_of_value_is_written_as_scipy_writes_it(ours, scipys):
    assert written(ours)[HEADER:] == by_scipy(scipys)[HEADER:]


def test_the_header_names_the_version_and_the_order_of_bytes():
    ours, scipys = written({"a": "b"}), by_scipy({"a": "b"})
    assert ours[:20] == scipys[:20] == b"MATLAB 5.0 MAT-file "
    # after the text: no subsystem, version 1, little-endian, on whatever machine
    assert ours[116:HEADER] == bytes(8) + b"\x00\x01IM"
    assert loadmat(BytesIO(ours), simplify_cells=True)["run"] == {"a": "b"}
