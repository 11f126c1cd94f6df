"""Arrays that are freed leave their memory to the next ones, unless the user has set the C library otherwise."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from mccdcli.freed_memory import KEPT_BYTES, OF_THE_USER

ROUNDS, MIB = 20, 24
PAGES = ROUNDS * MIB * (1 << 20) // 4096

USES = f"""
import json, resource, sys
from mccdcli.freed_memory import keep_freed_memory
does = keep_freed_memory()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range({ROUNDS}):
    bytes(bytearray({MIB} << 20))
print(json.dumps([does, resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before]))
"""


def set_and_faults(**variables: str) -> tuple[bool, int]:
    """Whether the library was set, and the pages that were mapped while a process used much memory again and again."""
    environment = {name: value for name, value in os.environ.items() if name not in OF_THE_USER}
    done = subprocess.run(
        [sys.executable, "-c", USES], env=environment | variables, capture_output=True, text=True, check=True
    )
    does, faults = json.loads(done.stdout)
    return does, faults


@pytest.mark.skipif(sys.platform != "linux", reason="only the GNU C library is set")
def test_what_is_freed_is_used_again():
    does, faults = set_and_faults()
    if not does:
        pytest.skip("this C library cannot be set")
    # two blocks at a time, mapped once each
    assert faults < PAGES / 4


@pytest.mark.parametrize("name", OF_THE_USER)
def test_what_the_user_has_set_stands(name):
    value = f"glibc.malloc.mmap_threshold={1 << 20}" if name == "GLIBC_TUNABLES" else str(1 << 20)
    does, _ = set_and_faults(**{name: value})
    assert not does


def test_the_amount_fits_into_what_the_library_takes():
    assert 0 < KEPT_BYTES < 2**31  # mallopt(int, int)
