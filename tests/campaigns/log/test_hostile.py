"""Files made to do harm are refused inside a memory bound, without a look outside the file."""

import os
import resource
import subprocess
import sys
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from campaigns.log import sidecar_of
from tests.campaigns.log.conftest import write_small_log

HEADROOM_BYTES = 512 * 2**20  # above what the libraries map at start: less than any bomb below would take

# Reads everything that the log offers, with the memory limited; prints what the one clear line says.
READER = f"""
import resource, sys
from campaigns.log import read_run
from sim_backend.errors import MccdError
mapped = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (mapped + {HEADROOM_BYTES}, mapped + {HEADROOM_BYTES}))
for path in sys.argv[1:]:
    try:
        with read_run(path) as run:
            for _ in run.blocks():
                pass
        print("read", path)
    except MccdError as error:
        print(type(error).__name__, error)
"""


# For thousands of files: children that are forked, with everything imported.
FORKED = """
from benchmarks.forked import forked
from campaigns.log import probe
probe.start_python = forked
"""
ROOT = Path(__file__).parents[3]


def read_bounded(*paths: Path, seconds: float = 60.0, first: str = "") -> list[str]:
    """Return the reader's line for each path; fail when it crashed, printed a traceback or took too long."""
    command = [sys.executable, "-c", first + READER, *map(str, paths)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=seconds, cwd=ROOT)
    assert (result.returncode, result.stderr) == (0, ""), result.stderr[-2000:]
    lines = result.stdout.splitlines()
    assert len(lines) == len(paths)
    return lines


pytestmark = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc to bound the memory")


def replace_channel(file: h5py.File, make) -> None:
    """Put what `make(group)` makes under the name of the channel `angle_x`, with that channel's attributes."""
    group = file["channels"]
    attributes = dict(group["angle_x"].attrs)
    del group["angle_x"]
    made = make(group)
    if isinstance(made, h5py.Dataset):
        for name, value in attributes.items():
            made.attrs[name] = value


def absurd_shape(group):
    return group.create_dataset("angle_x", shape=(2**50,), dtype="f8", chunks=(1024,))


def bomb(group):
    """A chunk of 8 MiB zeros takes 8 kB; the same compressed bytes stand for each of 1024 chunks, 8 GiB in all."""
    rows = 2**20
    dataset = group.create_dataset("angle_x", shape=(1024 * rows,), dtype="f8", chunks=(rows,), compression=9)
    packed = zlib.compress(bytes(8 * rows), 9)
    for chunk in range(1024):
        dataset.id.write_direct_chunk((chunk * rows,), packed)
    return dataset


def huge_chunk(group):
    return group.create_dataset("angle_x", shape=(2**27,), dtype="f8", chunks=(2**27,), compression=1)


def virtual(group):
    layout = h5py.VirtualLayout((1000,), "f8")
    layout[:] = h5py.VirtualSource("secret.h5", "data", (1000,))
    return group.create_virtual_dataset("angle_x", layout)


def outside_storage(group):
    return group.create_dataset("angle_x", (1000,), "f8", external=[("secret.raw", 0, 8000)])


def variable_length(group):
    return group.create_dataset("angle_x", (1000,), h5py.vlen_dtype(np.dtype("f8")))


def references(group):
    return group.create_dataset("angle_x", (1000,), h5py.ref_dtype)


def foreign_filter(group):
    return group.create_dataset("angle_x", (1000,), "f8", chunks=(100,), scaleoffset=3)


def many_axes(group):
    return group.create_dataset("angle_x", (1,) * 20, "f8")


def link(target):
    def make(group):
        group["angle_x"] = target

    return make


def cycle(group):
    group["angle_x"] = group


HOSTILE = {
    "absurd-shape": (absurd_shape, "stored bytes"),
    "bomb": (bomb, "stored bytes"),
    "huge-chunk": (huge_chunk, "chunks of"),
    "virtual": (virtual, "virtual"),
    "outside-storage": (outside_storage, "another file"),
    "variable-length": (variable_length, "variable length"),
    "references": (references, "variable length"),
    "foreign-filter": (foreign_filter, "filter"),
    "many-axes": (many_axes, "20 axes"),
    "external-link": (link(h5py.ExternalLink("secret.h5", "/data")), "external"),
    "soft-link": (link(h5py.SoftLink("/channels/torque_x")), "soft"),
    "soft-link-to-itself": (link(h5py.SoftLink("/channels/angle_x")), "soft"),
    "cycle": (cycle, "not a one-dimensional"),
    "group": (lambda group: group.create_group("angle_x"), "not a one-dimensional"),
    "named-type": (link(np.dtype("f8")), "neither group nor dataset"),
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory) -> dict[str, str]:
    """What one reader says of each hostile log, one after the other."""
    folder = tmp_path_factory.mktemp("hostile")
    with h5py.File(folder / "secret.h5", "w") as secret:
        secret["data"] = np.full(1000, 42.0)
    (folder / "secret.raw").write_bytes(np.full(1000, 42.0).tobytes())
    paths = [folder / f"{name}.h5" for name in HOSTILE]
    for path in paths:
        write_small_log(path)
        sidecar_of(path).unlink()
        with h5py.File(path, "r+") as file:
            replace_channel(file, HOSTILE[path.stem][0])
    return dict(zip(HOSTILE, read_bounded(*paths), strict=True))


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_channel_is_refused(answers, name):
    line, said = answers[name], HOSTILE[name][1]
    assert line.startswith("DataError") and said in line and "/channels/angle_x" in line or "channels/angle_x" in line
    assert said in line


@pytest.mark.parametrize("item", ["channels", "segments", "committed_rows"])
def test_links_in_place_of_the_main_parts_are_refused(unsealed, item):
    path = unsealed
    os.link(path, path.parent / "other.h5")
    (path.parent / "copy.h5").write_bytes(path.read_bytes())
    with h5py.File(path.parent / "copy.h5", "r+") as file:
        del file[item]
        file[item] = h5py.ExternalLink("other.h5", "/" + item)
    (line,) = read_bounded(path.parent / "copy.h5")
    assert line.startswith("DataError") and "external" in line and f"'/{item}'" in line


@pytest.mark.parametrize(("name", "said"), [(b"\xff\xfe", "not UTF-8"), (b"\x1b[31mred\nline", "cannot be a name")])
def test_names_that_are_not_utf_8_or_that_draw_are_refused_and_shown_escaped(unsealed, name, said):
    path = unsealed
    with h5py.File(path, "r+") as file:
        group = file["channels"].id
        group.links.create_hard(name, group, b"angle_x")
    (line,) = read_bounded(path)  # one line only, so the line feed was escaped
    assert line.startswith("DataError") and said in line and "\x1b" not in line


def test_a_crowd_of_channels_is_refused(unsealed):
    path = unsealed
    with h5py.File(path, "r+") as file:
        for index in range(5000):
            file["channels"][f"x{index}"] = h5py.SoftLink("/")
    assert "5002 items of at most 4096" in read_bounded(path)[0]


def test_a_table_of_segments_beyond_all_bounds_is_refused(unsealed):
    path = unsealed
    with h5py.File(path, "r+") as file:
        kind = file["segments"].dtype
        del file["segments"]
        file.create_dataset("segments", (2**40,), kind, chunks=(64,))
    (line,) = read_bounded(path)
    assert line.startswith("DataError") and "segments" in line


def test_markup_in_the_metadata_is_text_like_any_other(tmp_path, channels):
    """The log keeps it as it is; who shows it has to escape it."""
    from campaigns.log import LogWriter, read_run

    evil = "<script>alert(1)</script>"
    with LogWriter.create(tmp_path / "a.h5", channels, test="t", bench={"name": evil}, configuration=evil) as log:
        log.begin_segment(evil)
    with read_run(tmp_path / "a.h5") as run:
        assert run.header.bench["name"] == run.header.configuration == run.segments[0].label == evil


def mutated(content: bytes, seed: int) -> bytes:
    """A copy with a few bytes changed, most of them in the tables, some stretches cut out or repeated."""
    rng = np.random.default_rng(seed)
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 9))):
        position = int(rng.integers(0, min(len(changed), 12_000 if rng.random() < 0.8 else len(changed))))
        kind = rng.integers(0, 4)
        if kind == 0:
            changed[position] ^= 1 << int(rng.integers(0, 8))
        elif kind == 1:
            changed[position] = int(rng.choice([0, 1, 127, 128, 254, 255]))
        elif kind == 2:
            changed[position : position + 8] = (0, 2**31, 2**63, 2**64 - 1)[int(rng.integers(0, 4))].to_bytes(
                8, "little"
            )
        else:
            del changed[position : position + int(rng.integers(1, 64))]
    return bytes(changed)


def fuzz(path: Path, seeds: range, first: str = "") -> None:
    content = path.read_bytes()
    paths = []
    for seed in seeds:
        paths.append(path.with_name(f"mutated{seed}.h5"))
        paths[-1].write_bytes(mutated(content, seed))
    for line in read_bounded(*paths, seconds=60 + 2.0 * len(paths), first=first):
        assert line.split()[0] in ("read", "DataError")
    for mutation in paths:
        mutation.unlink()


def test_mutated_logs_are_read_or_refused(unsealed):
    fuzz(unsealed, range(40))


@pytest.mark.soak
def test_many_mutated_logs_are_read_or_refused(unsealed):
    for first in range(10_000, 30_000, 1000):
        fuzz(unsealed, range(first, first + 1000), FORKED)


def test_the_bound_would_be_met_by_a_reader_without_the_checks(unsealed):
    """The limit can fail: the same bomb read plainly does not fit."""
    path = unsealed
    with h5py.File(path, "r+") as file:
        replace_channel(file, bomb)
    script = READER.split("for path")[0] + "import h5py\nh5py.File(sys.argv[1])['channels/angle_x'][:]\n"
    result = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True, timeout=60)
    assert result.returncode != 0 and "MemoryError" in result.stderr
    assert resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY  # of this process
