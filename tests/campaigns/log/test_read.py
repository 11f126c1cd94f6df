"""What read_run gives: from our own logs, from logs that plain h5py wrote, and from runs that are not closed."""

import shutil

import h5py
import numpy as np
import pytest

from campaigns.log import Channel, LogWriter, read_run
from sim_backend.errors import ConfigError, DataError


@pytest.fixture
def plain_log(tmp_path):
    """The smallest log that the format allows, written without any of our code."""
    path = tmp_path / "plain.h5"
    with h5py.File(path, "w") as file:
        for name in (
            "run_uid",
            "test",
            "configuration",
            "started_utc",
            "tool_version",
            "tool_commit",
            "status",
            "bench",
        ):
            file.attrs[name] = "x"
        file.attrs["schema"], file.attrs["bench"], file.attrs["status"] = "mccd-log/1", '{"kind": "other"}', "complete"
        file.attrs["started_utc"] = "2026-03-01T12:00:00Z"
        dataset = file.create_dataset("channels/x", data=np.arange(10, dtype="<f4"))
        for name, value in {"unit": "m", "role": "output", "dof": "z", "sample_rate_hz": 5.0, "t0_s": 1.0}.items():
            dataset.attrs[name] = value
        kind = np.dtype([("label", "S20"), ("start", "<i8"), ("stop", "<i8"), ("settings", "S20")])
        file["segments"] = np.array([(b"one", 2, 6, b"{}")], kind)
        file["committed_rows"] = np.int64(8)
    return path


def test_round_trip(small_log, channels):
    path, data = small_log
    with read_run(path) as run:
        assert (run.status, run.rows, run.sample_rate_hz, run.header.seed) == ("complete", 1000, 10_000.0, 5)
        assert list(run.channels.values()) == channels
        assert run.names("input") == ("torque_x",) and run.names("aux") == ()
        for name, column in data.items():
            np.testing.assert_array_equal(run.read(name), column)
            np.testing.assert_array_equal(run.read(name, 127, 129), column[127:129])
            np.testing.assert_array_equal(run.window("sweep up").read(name), column[:450])
        assert run.window("sweep up").settings == {"amplitude_rad": 0.0045, "levels": [0, 1, 2]}
        assert [part.held_out for part in run.segments] == [False, True]
        np.testing.assert_allclose(run.time_s("angle_x", 10, 12), [5e-5 + 10e-4, 5e-5 + 11e-4], rtol=1e-15)


@pytest.mark.parametrize("rows", [1, 128, 300, 5000])
def test_blocks_put_together_are_the_whole(small_log, rows):
    path, data = small_log
    with read_run(path) as run:
        blocks = list(run.blocks(rows=rows))
        assert max(block["angle_x"].size for _, block in blocks) == min(rows, 1000)
        assert [first for first, _ in blocks] == list(range(0, 1000, rows))
        np.testing.assert_array_equal(np.concatenate([block["angle_x"] for _, block in blocks]), data["angle_x"])
        window = run.window("held-out µ")
        np.testing.assert_array_equal(
            np.concatenate([block["torque_x"] for _, block in window.blocks(("torque_x",), rows)]),
            data["torque_x"][550:],
        )


def test_a_log_written_by_plain_h5py_is_read(plain_log, seal):
    with read_run(seal(plain_log)) as run:
        assert run.channels["x"] == Channel("x", "m", "output", "z", 5.0, 1.0)
        np.testing.assert_array_equal(run.read("x"), np.arange(8.0))  # rows beyond the counter do not exist
        assert (run.header.seed, run.header.ended_utc) == (None, "")
        np.testing.assert_array_equal(run.window("one").read("x"), [2.0, 3.0, 4.0, 5.0])
        np.testing.assert_array_equal(run.window("one").time_s("x"), 1.0 + np.array([2, 3, 4, 5]) / 5.0)


def test_what_is_not_there_is_refused_with_what_is(small_log):
    with read_run(small_log[0]) as run:
        with pytest.raises(ConfigError, match="no channel 'angle_y': it has angle_x, torque_x"):
            run.read("angle_y")
        with pytest.raises(ConfigError, match="no segment 'chop': it has held-out µ, sweep up"):
            run.window("chop")
        for start, stop in ((-1, 5), (5, 1001), (7, 6)):
            with pytest.raises(ConfigError, match="samples 0 to 1000"):
                run.read("angle_x", start, stop)


def test_a_run_being_written_shows_its_committed_rows_and_a_copy_of_it_counts_as_crashed(tmp_path, channels):
    """The copy is what a kill would leave; in this process HDF5 would share one open file between both sides."""
    path, copy = tmp_path / "live.h5", tmp_path / "copy.h5"
    with LogWriter.create(path, channels, test="t", bench={}, chunk_rows=64) as log:
        log.begin_segment("a")
        log.append({"torque_x": np.arange(100.0), "angle_x": np.arange(100.0)})
        log.end_segment()
        log.begin_segment("b")
        log.append({"torque_x": np.arange(20.0), "angle_x": np.arange(20.0)})
        shutil.copyfile(path, copy)
    with read_run(copy) as run:
        assert (run.status, run.rows) == ("crashed", 64)
        np.testing.assert_array_equal(run.read("angle_x"), np.arange(64.0))
        assert [(part.label, part.start, part.stop) for part in run.segments] == [("a", 0, 64)]


ATTRIBUTES = [
    ("schema", "mccd-log/2", "mccd import"),
    ("schema", None, "schema ''"),
    ("run_uid", None, "is missing"),
    ("run_uid", "", "cannot be a name"),
    ("test", np.arange(3), "not a single text"),
    ("test", 5.0, "is not text"),
    ("test", np.bytes_(b"\xff\xfe"), "not UTF-8"),
    ("status", "splendid", "'splendid' is unknown"),
    ("started_utc", "2026-03-01", "zone"),
    ("bench", "[1]", "not a JSON object"),
    ("bench", "[" * 100_000, "not a JSON object"),
    ("bench", '{"stiffness": 11.16}', "no parameters"),
    ("seed", "seven", "not a single number"),
    ("seed", np.float64("nan"), "damaged"),
]


@pytest.mark.parametrize(("name", "value", "said"), ATTRIBUTES)
def test_a_damaged_header_is_one_clear_line(plain_log, seal, name, value, said):
    with h5py.File(plain_log, "r+") as file:
        file.attrs.pop(name, None)
        if value is not None:
            file.attrs[name] = value
    with pytest.raises(DataError) as caught:
        read_run(seal(plain_log))
    assert said in str(caught.value) and str(plain_log) in str(caught.value) and "\n" not in str(caught.value)


CHANNEL_ATTRIBUTES = [
    ("unit", "furlong", "unknown unit"),
    ("unit", "mm", "convert to 'm'"),
    ("role", "sideways", "sideways"),
    ("sample_rate_hz", 0.0, "0.0 Hz"),
    ("sample_rate_hz", None, "no sample_rate_hz"),
    ("sample_rate_hz", np.arange(2.0), "not a single text or number"),
    ("t0_s", np.inf, "inf s"),
]


@pytest.mark.parametrize(("name", "value", "said"), CHANNEL_ATTRIBUTES)
def test_a_damaged_channel_is_one_clear_line(plain_log, seal, name, value, said):
    with h5py.File(plain_log, "r+") as file:
        attributes = file["channels/x"].attrs
        del attributes[name]
        if value is not None:
            attributes[name] = value
    with pytest.raises(DataError) as caught:
        read_run(seal(plain_log))
    assert said in str(caught.value) and "\n" not in str(caught.value)


TABLES = [
    ([(b"one", 5, 3, b"{}")], "from sample 5 to 3"),
    ([(b"one", -7, 3, b"{}")], "from sample -7"),
    ([(b"one", 0, 4, b"{}"), (b"two", 3, 5, b"{}")], "overlapping"),
    ([(b"one", 0, 4, b"{}"), (b"one", 4, 5, b"{}")], "used twice"),
    ([(b"one", 0, 4, b"{")], "not a JSON object"),
    ([(b"\xff", 0, 4, b"{}")], "damaged"),
]


@pytest.mark.parametrize(("rows", "said"), TABLES)
def test_a_damaged_table_of_segments_is_one_clear_line(plain_log, seal, rows, said):
    with h5py.File(plain_log, "r+") as file:
        kind = file["segments"].dtype
        del file["segments"]
        file["segments"] = np.array(rows, kind)
    with pytest.raises(DataError, match=said):
        read_run(seal(plain_log))


@pytest.mark.parametrize(
    ("item", "data", "said"),
    [
        ("committed_rows", np.int64(11), "fewer than the 11 committed"),
        ("committed_rows", np.int64(-1), "less than 0"),
        ("committed_rows", np.arange(2), "not a single integer"),
        ("committed_rows", None, "'/committed_rows' is missing"),
        ("segments", np.arange(3), "not a table"),
        ("segments", None, "'/segments' is missing"),
        ("channels/x", np.zeros((10, 1)), "not a one-dimensional"),
        ("channels/x", np.array([b"a"] * 10), "not a one-dimensional"),
        ("channels/x", None, "no channels"),
        ("channels", None, "'/channels' is missing"),
        ("channels", np.arange(3), "is not a group"),
    ],
)
def test_a_damaged_structure_is_one_clear_line(plain_log, seal, item, data, said):
    with h5py.File(plain_log, "r+") as file:
        del file[item]
        if data is not None:
            file[item] = data
    with pytest.raises(DataError, match=said):
        read_run(seal(plain_log))


@pytest.mark.parametrize("content", [b"", b"no log", b"\x89HDF\r\n\x1a\n", b"\x89HDF\r\n\x1a\n" + b"\0" * 4000])
def test_foreign_bytes_are_refused(tmp_path, content):
    path = tmp_path / "a.h5"
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"a\.h5"):
        read_run(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    for path in (tmp_path / "absent.h5", tmp_path):
        with pytest.raises(DataError, match="not a file"):
            read_run(path)


def test_a_log_cut_short_is_refused(small_log, seal):
    path, _ = small_log
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DataError, match="its checksum differs"):
        read_run(path)
    with pytest.raises(DataError, match="truncated"):
        read_run(seal(path))


def test_a_log_without_checksum_is_read_after_a_first_look(unsealed):
    with read_run(unsealed) as run:
        assert run.rows == 1000


@pytest.mark.parametrize("size", [0, 2**64 - 1])
def test_damage_that_the_library_does_not_survive_is_one_clear_line(unsealed, monkeypatch, size):
    """The texts of the header lie in a heap of objects, each with its size; a size of 0 leads back to itself."""
    monkeypatch.setattr("campaigns.log.child.START_S", 3.0)
    content = bytearray(unsealed.read_bytes())
    heap = content.index(b"GCOL")
    content[heap + 24 : heap + 32] = size.to_bytes(8, "little")
    unsealed.write_bytes(content)
    with pytest.raises(DataError) as caught:
        read_run(unsealed)
    assert str(unsealed) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(("size", "said"), [(1e308, "1e.308"), (5e-324, "4.94.*e-324"), (1e-310, "1e-310")])
def test_numbers_that_nothing_can_be_computed_with_are_refused(tmp_path, size, said):
    path = tmp_path / "run.h5"
    values = size * np.array([0.0, 1.0, -1.0, np.nan])
    with LogWriter.create(path, [Channel("a", "rad", "output", "z", 1e4)], test="fuzz", bench={"kind": "sim"}) as log:
        log.append({"a": values})
    with read_run(path) as run:
        with pytest.raises(DataError, match=f"'a' holds {said} as its largest number; it must lie between"):
            run.read("a")
        np.testing.assert_array_equal(next(run.blocks())[1]["a"], values)  # what copies or shows it still can
