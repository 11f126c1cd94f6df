"""Object code that is put into memory here does what it does where LLVM loads it; what is not known is left to LLVM."""

from __future__ import annotations

import ctypes
import json
import os
import platform
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sim_backend import machine_code, noise, object_code
from sim_backend.kernel_cache import VARIABLE
from sim_backend.machine_code import NAME, compiled
from sim_backend.object_code import Linked, in_memory

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64", reason="elsewhere LLVM loads all code"
)


@pytest.fixture(scope="module")
def code() -> bytes:
    """Code with constants, tables and functions of the C library: that of normal random numbers."""
    return compiled(noise._fill.alone, {})  # noqa: SLF001 no other kernel has all of that


def drawn(linked: Linked, n: int) -> np.ndarray:
    """What numpy's generator of seed 1 draws through the code."""
    whole = np.random.default_rng(1).bit_generator.state["state"]
    half = (1 << 64) - 1
    state = np.array([w >> s & half for w in (whole["state"], whole["inc"]) for s in (64, 0)], dtype=np.uint64)
    out = np.empty(n)
    fill = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_ssize_t, ctypes.c_void_p)(linked.address)
    fill(state.ctypes.data, 1, n, out.ctypes.data)
    return out


def test_it_computes_what_numpy_does_and_what_llvm_loads(code: bytes) -> None:
    here = in_memory(code, NAME)
    assert here is not None
    known = np.random.default_rng(1).standard_normal(100_000)
    np.testing.assert_array_equal(drawn(here, known.size), known)
    np.testing.assert_array_equal(drawn(machine_code._linked_by_llvm(code), known.size), known)  # noqa: SLF001


def test_nobody_can_write_it(code: bytes) -> None:
    here = in_memory(code, NAME)
    assert here is not None
    for line in Path("/proc/self/maps").read_text().splitlines():
        first, last = (int(end, 16) for end in line.split()[0].split("-"))
        if first <= here.address < last:
            assert line.split()[1] == "r-xp"
            return
    raise AssertionError("the code lies nowhere")


def changed(code: bytes, at: int, value: bytes) -> bytes:
    return code[:at] + value + code[at + len(value) :]


def sections(code: bytes) -> list[tuple[int, tuple[int, ...]]]:
    """Where the head of each section stands, and what stands there."""
    table, size, count = struct.unpack_from("<Q", code, 40)[0], *struct.unpack_from("<HH", code, 58)
    return [(table + i * size, struct.unpack_from("<IIQQQQIIQQ", code, table + i * size)) for i in range(count)]


def test_another_format_or_processor_is_left_to_llvm(code: bytes) -> None:
    assert in_memory(b"", NAME) is None
    assert in_memory(changed(code, 0, b"\xcf\xfa\xed\xfe"), NAME) is None  # as under macOS
    assert in_memory(changed(code, 18, struct.pack("<H", 183)), NAME) is None  # 64-bit ARM


def test_an_address_of_another_kind_is_left_to_llvm(code: bytes) -> None:
    (at,) = (head[4] for _, head in sections(code) if head[1] == 4 and head[5])
    assert struct.unpack_from("<I", code, at + 8) == (1,)
    assert in_memory(changed(code, at + 8, struct.pack("<I", 2)), NAME) is None


@pytest.mark.parametrize("flag", [0x1, 0x400])
def test_memory_that_is_written_or_of_a_thread_is_left_to_llvm(code: bytes, flag: int) -> None:
    place, flags = next((at, head[2]) for at, head in sections(code) if head[2] & 0x2)
    assert in_memory(changed(code, place + 8, struct.pack("<Q", flags | flag)), NAME) is None


def test_a_function_that_the_process_does_not_have_is_left_to_llvm(code: bytes) -> None:
    assert code.count(b"\0log1p\0") == 1
    assert in_memory(code.replace(b"\0log1p\0", b"\0log9p\0"), NAME) is None


def test_where_no_memory_for_code_is_granted_llvm_is_asked(code: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    process = object_code._process()  # noqa: SLF001 what it asks the system by

    class Strict:
        mprotect = staticmethod(lambda *_: -1)

        def __getattr__(self, name: str) -> object:
            return getattr(process, name)

    monkeypatch.setattr(object_code, "_process", Strict)
    assert in_memory(code, NAME) is None
    known = np.random.default_rng(1).standard_normal(1000)
    np.testing.assert_array_equal(drawn(machine_code.linked(code), known.size), known)


def test_a_process_that_finds_its_code_plays_without_llvm(tmp_path: Path) -> None:
    script = (
        "import json, sys\n"
        "import numpy as np\n"
        "from sim_backend.bench import Segment\n"
        "from sim_backend.model import load_model\n"
        "from sim_backend.simbench import SimBench\n"
        "rest = np.zeros((1, 3))\n"
        "played = SimBench(load_model('as-built'), 1).play(Segment('rest', 300, rest, rest)).channels\n"
        "heavy = {'llvmlite', 'numba', 'importlib.metadata', 'scipy.linalg'} & set(sys.modules)\n"
        "print(json.dumps([sorted(heavy), {name: values.tobytes().hex() for name, values in played.items()}]))"
    )
    told = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", script],
            capture_output=True,
            text=True,
            check=True,
            timeout=300,
            env=os.environ | {VARIABLE: str(tmp_path)},
        )
        told.append(json.loads(done.stdout))
    assert "llvmlite" in told[0][0]
    assert told[1][0] == []
    assert told[0][1] == told[1][1]
