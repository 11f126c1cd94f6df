"""Timetables and other objects of MATLAB beside plain data are passed over; asked for, one says how to export it.

No MATLAB is at hand: the bytes of an object are written by its published form, and are what scipy reads as one.
"""

from __future__ import annotations

import struct

import h5py
import numpy as np
import pytest
import scipy.io

from campaigns.importing import foreign
from sim_backend.errors import DataError
from tests.campaigns.importing.arrays import whole

REFERENCE = np.array([0xDD000000, 2, 1, 1, 1, 1], dtype="<u4")
"""What stands in the place of an object: a mark, a shape and numbers that point into another part of the file."""


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def opaque(name: str, of: str) -> bytes:
    flags, shape = struct.pack("<II", 13, 0), struct.pack("<ii", 6, 1)
    inner = element(6, flags) + element(5, shape) + element(1, b"") + element(6, REFERENCE.tobytes())
    texts = b"".join(element(1, text.encode()) for text in (name, "MCOS", of))
    return element(14, element(6, struct.pack("<II", 17, 0)) + texts + element(14, inner))


def version_5(path, of, first, compressed):
    scipy.io.savemat(path, {"u": np.arange(5.0), "s": {"y": np.arange(4.0)}}, do_compression=compressed)
    data = path.read_bytes()
    added = opaque("TT", of)
    path.write_bytes(data[:128] + added + data[128:] if first else data + added)
    assert scipy.io.loadmat(path)["None"].item()[:3] == (b"TT", b"MCOS", of.encode()), "as scipy reads an object"


def version_73(path, of, first, compressed):
    with h5py.File(path, "w", userblock_size=512) as file:
        file["u"] = np.arange(5.0)[:, None]
        file["s/y"] = np.arange(4.0)[:, None]
        file["TT"] = REFERENCE[None]
        file["TT"].attrs["MATLAB_class"] = np.bytes_(of)
        file["TT"].attrs["MATLAB_object_decode"] = np.int32(3)
        file["#refs#/a"] = np.arange(3.0)


@pytest.mark.parametrize("first", [True, False], ids=["before", "after"])
@pytest.mark.parametrize("compressed", [True, False], ids=["packed", "plain"])
@pytest.mark.parametrize("write", [version_5, version_73])
def test_a_timetable_beside_plain_data_is_passed_over(tmp_path, write, first, compressed):
    path = tmp_path / "a.mat"
    write(path, "timetable", first, compressed)
    source = foreign._source(path)  # noqa: SLF001
    assert sorted(source.names()) == ["s", "u"]
    u, y = source.pieces("u"), source.pieces("s.y")
    assert u is not None and y is not None
    np.testing.assert_array_equal(whole(u).ravel(), np.arange(5.0))
    np.testing.assert_array_equal(whole(y).ravel(), np.arange(4.0))


@pytest.mark.parametrize("write", [version_5, version_73])
@pytest.mark.parametrize(
    ("of", "said"), [("timetable", "timetable2table"), ("table", "table2struct"), ("datetime", "posixtime")]
)
@pytest.mark.parametrize("name", ["TT", "TT.y"])
def test_an_object_that_is_asked_for_says_how_to_export_it(tmp_path, write, of, said, name):
    path = tmp_path / "a.mat"
    write(path, of, False, False)
    with pytest.raises(DataError, match=f"'TT.*is a MATLAB {of}.*{said}"):
        foreign._source(path).pieces(name)  # noqa: SLF001
