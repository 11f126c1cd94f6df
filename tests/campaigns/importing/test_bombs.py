"""Small files that unpack to gigabytes cost less than one, in the command and its readers together, whatever they tell.

Each is made by hand from a few bytes that are repeated, so that a test does not need the memory that it forbids.
"""

from __future__ import annotations

import io
import os
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.campaigns.importing.test_hostile import MAP, element

pytestmark = pytest.mark.usefixtures("started_readers")

MOST_BYTES = 2**30
ROWS = 2**29
"""Of doubles: 4 GiB."""

COMMAND = r"""
import re, resource
from mccdcli.main import main
code = main(["import", "map.toml", "-o", "out.h5"])
# ru_maxrss of a process begins with that of the one that started it
own = int(re.search(r"VmHWM:\s+(\d+)", open("/proc/self/status").read())[1])
print(code, 1024 * own, 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def sparse(path: Path, head: bytes, length: int) -> None:
    path.write_bytes(head)
    os.truncate(path, length)


def npy_head(rows: int = ROWS) -> bytes:
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (rows,)})
    return head.getvalue()


def deflated(head: bytes, zeros: int) -> bytes:
    """Deflated `head` and zeros, 1000 times smaller."""
    packer, piece = zlib.compressobj(9, wbits=-15), bytes(2**23)
    start = packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH)
    again = packer.compress(piece) + packer.flush(zlib.Z_FULL_FLUSH)
    return start + again * (zeros // 2**23) + b"\x03\x00"


def npz(path: Path, *members: tuple[str, bytes, int, int, int, int]) -> None:
    """A zip of members (name, packed bytes, method, checksum, and the sizes that are told: packed and unpacked)."""
    body, directory = b"", b""
    for name, data, method, check, packed, size in members:
        told = struct.pack("<HHHHHIIIHH", 20, 0, method, 0, 0, check, packed, size, len(name), 0)
        directory += b"PK\x01\x02" + struct.pack("<H", 20) + told + struct.pack("<HHHII", 0, 0, 0, 0, len(body))
        directory += name.encode()
        body += b"PK\x03\x04" + told + name.encode() + data
    end = struct.pack("<HHHHIIH", 0, 0, len(members), len(members), len(directory), len(body), 0)
    path.write_bytes(body + directory + b"PK\x05\x06" + end)


def npz_of_two_names(path: Path) -> None:
    """A sound archive: the small array is what a check sees, the large one what numpy loads."""
    packed, small = deflated(npy_head(2**27), 2**30), npy_head(0)
    check = zlib.crc32(npy_head(2**27))
    for _ in range(2**7):
        check = zlib.crc32(bytes(2**23), check)
    big = ("x", packed, 8, check, len(packed), 2**30 + 128)
    npz(path, big, ("x.npy", small, 0, zlib.crc32(small), len(small), len(small)))


def npz_that_lies(path: Path) -> None:
    packed = deflated(npy_head(2**28), 2**31)
    npz(path, ("x.npy", packed, 8, 0, 2**30, 2**31 + 128))


def npz_of_a_short_claim(path: Path) -> None:
    packed = deflated(npy_head(2**20), 2**31)
    npz(path, ("x.npy", packed, 8, 0, len(packed), 2**23 + 128))


def npz_of_another_method(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_BZIP2) as archive, archive.open("x.npy", "w") as member:
        member.write(npy_head(2**20) + bytes(2**23))


def npz_of_many_members(path: Path) -> None:
    """Each of its 40 members unpacks to no more than one may."""
    rows = 31 * 2**20
    packed = deflated(npy_head(rows), 8 * rows)
    npz(path, *((f"x{i:02d}.npy", packed, 8, 0, len(packed), 8 * rows + 128) for i in range(40)))


def array_of_a_long_header(path: Path) -> None:
    sparse(path, b"\x93NUMPY\x02\x00" + struct.pack("<I", 3 * 10**9) + b"{", 3 * 10**9 + 12)


def text_without_lines(path: Path) -> None:
    sparse(path, "\ufeffx\n1.0\n2.0\n".encode("utf-16-le"), 8 * ROWS)


def text_in_one_line(path: Path) -> None:
    with path.open("wb") as file:
        file.write(b"x\n1.0\n2.0\n")
        for _ in range(300):
            file.write(b"1" * 2**20)


def text_of_a_long_name(path: Path) -> None:
    """As fixed cells of a table of names, all would be as wide as the widest."""
    path.write_text("x\n" + "1.0\n" * 200_000 + "y" * 2**19 + "\n" + "1.0\n")


def array_with_holes(path: Path) -> None:
    sparse(path, npy_head(), 128 + 8 * ROWS)


def matlab_with_holes(path: Path) -> None:
    count = 2**28 - 2**10
    inner = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", count, 1)) + element(1, b"x")
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    head += struct.pack("<II", 14, len(inner) + 8 + 8 * count) + inner + struct.pack("<II", 9, 8 * count)
    sparse(path, head, len(head) + 8 * count)


def hdf5_with_holes(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("x", (ROWS,), "f8").id.get_offset()
        file["x"][-1] = 1.0


def hdf5_of_lying_chunks(path: Path) -> None:
    """Each chunk says that it has 8 MiB and unpacks to 2 GiB."""
    with h5py.File(path, "w") as file:
        dataset = file.create_dataset("x", (2**22,), "f8", chunks=(2**20,), compression=9)
        packed = b"\x78\xda" + deflated(b"", 2**31)
        for first in range(0, 2**22, 2**20):
            dataset.id.write_direct_chunk((first,), packed)


def netcdf_with_holes(path: Path) -> None:
    def name(text: str) -> bytes:
        return struct.pack(">I", len(text)) + text.encode().ljust(-(-len(text) // 4) * 4, b"\0")

    rows = 2**28 - 2**10
    head = b"CDF\x02" + struct.pack(">I", 0) + struct.pack(">II", 10, 1) + name("t") + struct.pack(">I", rows)
    head += struct.pack(">II", 0, 0) + struct.pack(">II", 11, 1) + name("x") + struct.pack(">II", 1, 0)
    head += struct.pack(">II", 0, 0) + struct.pack(">II", 6, 8 * rows) + struct.pack(">Q", 256)
    sparse(path, head, 256 + 8 * rows)


def tdms_with_holes(path: Path) -> None:
    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    index = struct.pack("<IIIQ", 20, 10, 1, ROWS)
    meta = struct.pack("<I", 3) + text("/") + struct.pack("<II", 0xFFFFFFFF, 0)
    meta += text("/'g'") + struct.pack("<II", 0xFFFFFFFF, 0) + text("/'g'/'x'") + index + struct.pack("<I", 0)
    lead = b"TDSm" + struct.pack("<iIQQ", 2 | 4 | 8, 4713, len(meta) + 8 * ROWS, len(meta))
    sparse(path, lead + meta, len(lead) + len(meta) + 8 * ROWS)


def parquet_of_one_value(path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    with pq.ParquetWriter(path, pa.schema([("x", pa.float64())])) as writer:
        table = pa.table({"x": pa.array(np.full(2**22, 1.5))})
        for _ in range(9):
            writer.write_table(table)


def npz_of_millions_of_members(path: Path) -> None:
    """Each takes 51 bytes of the directory, and some hundred of memory."""
    entry = struct.pack("<IHHHHHHIIIHHHHHII", 0x02014B50, 20, 20, 0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0)
    directory = b"".join(entry + f"{i:05x}".encode() for i in range(2**20))
    # more than 65,535 need the longer form
    end = struct.pack("<IQHHIIQQQQ", 0x06064B50, 44, 45, 45, 0, 0, 2**20, 2**20, len(directory), 0)
    end += struct.pack("<IIQI", 0x07064B50, 0, len(directory), 1)
    end += struct.pack("<IHHHHIIH", 0x06054B50, 0, 0, 0xFFFF, 0xFFFF, 0xFFFFFFFF, 0xFFFFFFFF, 0)
    path.write_bytes(directory + end)


def header(shape: str) -> bytes:
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def npz_of_less_than_nothing(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("x.npy", header("(-1,)") + bytes(80))


def array_of_a_deep_header(path: Path) -> None:
    path.write_bytes(header(f"({'-' * 9000}1,)") + bytes(80))


def text_of_numbers_but_the_last(path: Path) -> None:
    """Of 80 million numbers the last is none: what is refused is not kept until then."""
    with path.open("w") as file:
        file.write("x\n")
        for _ in range(80):
            file.write("1\n2\n" * 500_000)
        file.write("x1\n")


BOMBS: dict[str, tuple[Callable[[Path], None], str, str]] = {
    "npz-two-names": (npz_of_two_names, "npz", "x"),
    "npz-lies": (npz_that_lies, "npz", "x"),
    "npz-short-claim": (npz_of_a_short_claim, "npz", "x"),
    "npz-other-method": (npz_of_another_method, "npz", "x"),
    "npz-many-members": (npz_of_many_members, "npz", "x00"),
    "npz-millions-of-members": (npz_of_millions_of_members, "npz", "00000"),
    "npz-less-than-nothing": (npz_of_less_than_nothing, "npz", "x"),
    "npy-deep-header": (array_of_a_deep_header, "npy", "x"),
    "text-one-bad-cell": (text_of_numbers_but_the_last, "csv", "x"),
    "npy-holes": (array_with_holes, "npy", "x"),
    "npy-long-header": (array_of_a_long_header, "npy", "x"),
    "text-holes": (text_without_lines, "csv", "x"),
    "text-one-line": (text_in_one_line, "csv", "x"),
    "text-long-cell": (text_of_a_long_name, "csv", "x"),
    "mat-holes": (matlab_with_holes, "mat", "x"),
    "h5-holes": (hdf5_with_holes, "h5", "x"),
    "h5-lying-chunks": (hdf5_of_lying_chunks, "h5", "x"),
    "nc-holes": (netcdf_with_holes, "nc", "x"),
    "tdms-holes": (tdms_with_holes, "tdms", "g/x"),
    "parquet-one-value": (parquet_of_one_value, "parquet", "x"),
}


@pytest.mark.skipif(sys.platform != "linux", reason="peaks of memory are told in other units elsewhere")
@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_in_less_than_a_gibibyte(tmp_path, name):
    make, suffix, select = BOMBS[name]
    make(tmp_path / f"a.{suffix}")
    refused_in_little_memory(tmp_path, MAP.format(source=f"a.{suffix}", select=select))


@pytest.mark.skipif(sys.platform != "linux", reason="peaks of memory are told in other units elsewhere")
def test_a_map_that_selects_one_array_for_many_channels_is_refused(tmp_path):
    """Once it may be read, as a small file that unpacks to less than a quarter of a gibibyte; not twenty times."""
    rows = 31 * 2**20
    head, zeros = npy_head(rows), bytes(2**23)
    check = zlib.crc32(head)
    for _ in range(31):
        check = zlib.crc32(zeros, check)
    packed = deflated(head, 8 * rows)
    npz(tmp_path / "a.npz", ("x.npy", packed, 8, check, len(packed), len(head) + 8 * rows))
    one = MAP.format(source="a.npz", select="x")
    channel = one[one.index("[channels.") :]
    refused_in_little_memory(
        tmp_path, one + "".join(channel.replace("[channels.", f"[channels.c{i}", 1) for i in range(20))
    )


def refused_in_little_memory(folder, text):
    (folder / "map.toml").write_text(text)
    bounded = f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({6 * 2**30}, {6 * 2**30}))\n"
    run = subprocess.run(
        [sys.executable, "-c", bounded + COMMAND],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])},
    )
    code, *peaks = map(int, run.stdout.split())
    # what takes longer than a few seconds tells its progress, in lines of its own, on a slow computer as well
    told = [line for line in run.stderr.splitlines() if not line.startswith("importing: ")]
    assert code == 4 and len(told) == 1 and told[0].startswith("mccd: error: "), run.stderr[-2000:]
    assert sum(peaks) < MOST_BYTES, (peaks, run.stderr)
