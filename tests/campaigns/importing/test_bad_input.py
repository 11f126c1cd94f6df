"""Every mistake in a map or its data is one clear line, and leaves no log behind."""

import io
import os
import zipfile

import h5py
import numpy as np
import pytest

from campaigns.importing import import_run
from campaigns.importing.selecting import parse_selection
from sim_backend.errors import ConfigError, DataError, MccdError


def refuse(tmp_path, run_map, text: str, kind: type[MccdError]) -> str:
    with pytest.raises(kind) as caught:
        run_map(text)
    message = str(caught.value)
    assert "\n" not in message and "map.toml" in message
    assert not (tmp_path / "out.h5").exists()
    return message


@pytest.mark.parametrize(
    ("old", "new", "kind", "said"),
    [
        ('"mN m"', '"Nmm"', ConfigError, ["[channels.torque]", "unknown unit 'Nmm'", "did you mean"]),
        ('"tx"', '"hole"', DataError, ["no variable 'hole'", "did you mean 'holes'"]),
        ("a.npz", "b.npz", DataError, ["b.npz is not a file"]),
        ("a.npz", "a.xyz", DataError, ["suffix '.xyz'", ".npz"]),
        ("test =", "tset =", ConfigError, ["unknown field 'tset' in [log]", "did you mean 'test'"]),
        ("dof =", "doff =", ConfigError, ["unknown field 'doff'", "did you mean 'dof'"]),
        ("[channels.torque]", "[chanels.torque]", ConfigError, ["unknown field 'chanels'", "'channels'"]),
        ("sample_rate_hz = 10000.0", "", ConfigError, ["either sample_rate_hz or time"]),
        ("10000.0", "-1.0", ConfigError, ["sample_rate_hz"]),
        ("10000.0", "nan", ConfigError, ["sample_rate_hz"]),
        ("10000.0", "1e300", ConfigError, ["sample_rate_hz"]),
        ("10000.0", "'fast'", ConfigError, ["Expected `float | null`, got `str`", "sample_rate_hz"]),
        ("10000.0", "10000.0\nperiod = 600", DataError, ["period is 600", "only 500"]),
        ("10000.0", "10000.0\nperiod = 9223372036854775807", ConfigError, ["period"]),
        ("10000.0", '10000.0\naxes = ["period"]', ConfigError, ["name 'sample'"]),
        ("10000.0", '10000.0\naxes = ["samples"]', ConfigError, ["samples"]),
        ("10000.0", '10000.0\nstarted_utc = "yesterday"', ConfigError, ["started_utc", "zone"]),
        ('"output"', '"sideways"', ConfigError, ["sideways"]),
        ('"output"', '"output"\nscale = 0.0', ConfigError, ["scale 0.0"]),
        ('"output"', '"output"\nscale = inf', ConfigError, ["scale"]),
        ('"tx"', '"tx[:, 0]"', ConfigError, ["does not fit", "shape (500,)"]),
        ('"tx"', '"tx[__import__]"', ConfigError, ["index '__import__'"]),
        ('"tx"', '"t\\nx"', DataError, ["no variable 't\\nx'"]),
        ("dof =", '"\\u001b[31m" =', ConfigError, ["unknown field", "\\x1b[31m"]),
        ('"tx"', '"empty"', DataError, ["is empty"]),
        ('"tx"', '"constant"', DataError, ["constant at 0.003", "allow_constant"]),
        ('"tx"', '"holes"', DataError, ["nan at sample 7", "3 value(s)"]),
        ('"tx"', '"short"', DataError, ["'torque' has 100 samples and 'angle' has 500"]),
        ('"tx"', '"square"', DataError, ["shape (500, 2)", "select one column"]),
        ('"tx"', '"complex"', DataError, ["complex128", "real numbers"]),
        ('"tx"', '"words"', DataError, ["real numbers"]),
        ("[channels.torque]", '[channels."a/b"]', ConfigError, ["channel 'a/b' cannot be a name"]),
        ("test =", "test = = ", ConfigError, ["not valid TOML", "line 3"]),
        ("sample_rate_hz = 10000.0", 'time = "gap"', DataError, ["not uniform", "after sample 250 is 0.0002 s"]),
        ("sample_rate_hz = 10000.0", 'time = "short"', DataError, ["100 stamps for 500 samples"]),
        ("sample_rate_hz = 10000.0", 'time = "constant"', DataError, ["not uniform"]),
        ("sample_rate_hz = 10000.0", 'time = "backwards"', DataError, ["not uniform"]),
        ("[channels.angle]", "[channels.angle]\n" * 2, ConfigError, ["not valid TOML"]),
    ],
)
def test_a_mistake_is_one_clear_line(tmp_path, run_map, plain, data, old, new, kind, said):
    time = np.arange(500) * 1e-4
    np.savez(
        tmp_path / "a.npz",
        empty=np.empty(0),
        constant=np.full(500, 3.0),
        holes=np.where(np.isin(np.arange(500), (7, 8, 400)), np.nan, data["tx"]),
        short=data["tx"][:100],
        square=np.ones((500, 2)),
        complex=data["tx"] * 1j,
        words=np.full(500, "x"),
        gap=time + 1e-4 * (np.arange(500) > 250),
        backwards=time[::-1],
        **data,
    )
    (tmp_path / "a.xyz").write_text("")
    text = plain("a.npz")
    assert old in text
    message = refuse(tmp_path, run_map, text.replace(old, new, 1), kind)
    for part in said:
        assert part in message


@pytest.mark.parametrize(
    ("segments", "said"),
    [
        ("a = [0, 501]", "[0, 501] of 500"),
        ("a = [10, 10]", "start must be below stop"),
        ("a = [0, 100]\nb = [99, 200]", "starts at 99 before another ends at 100"),
        ("a = [-5, 100]", "-5"),
        ("a = [0, 1, 2]", "length 2"),
        (f"{'a' * 200} = [0, 5]", "segment label"),
    ],
)
def test_segments_that_cannot_be(tmp_path, run_map, plain, data, segments, said):
    np.savez(tmp_path / "a.npz", **data)
    with pytest.raises(ConfigError) as caught:
        run_map(plain("a.npz") + "[segments]\n" + segments)
    assert said in str(caught.value) or said == "-5"
    assert "segments" in str(caught.value) or "segment '" in str(caught.value) or "segment label" in str(caught.value)
    assert not (tmp_path / "out.h5").exists()


def test_parts_with_equal_labels_or_beside_segments(tmp_path, run_map, plain, data):
    np.savez(tmp_path / "a.npz", **data)
    part = '[[parts]]\nlabel = "x"\n'
    assert "2 times" in refuse(tmp_path, run_map, plain("a.npz") + part + part, ConfigError)
    text = plain("a.npz") + "[segments]\na = [0, 5]\n" + part
    assert "remove one of them" in refuse(tmp_path, run_map, text, ConfigError)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("tx,ax\n1,2\n3,oops\n5,6\n", "line 3: column 'ax' holds 'oops'"),
        ("tx,ax\n1,2\n3\n5,6\n", "line 3 has 1 cells, the others have 2"),
        ("tx,ax\n1,2\n3,4,5\n", "line 3 has 3 cells, the others have 2"),
        ("", "no line of data"),
        ("# only a comment\n", "no line of data"),
        ("tx,ax\n", "is empty"),
        ("1,2\n3,4\n", "no variable 'tx'"),
    ],
)
def test_text_tables_that_cannot_be_used(tmp_path, run_map, plain, content, said):
    (tmp_path / "a.csv").write_text(content)
    assert said in refuse(tmp_path, run_map, plain("a.csv"), DataError)


@pytest.mark.parametrize("name", ["a.csv", "a.tsv", "a.npy", "a.npz", "a.mat", "a.h5"])
@pytest.mark.parametrize(
    "content", [b"", b"\x00" * 600, b"\xff\xfe\x80 garbage \x00" * 50, b"\x93NUMPY\x01\x00\xff\xff{'a'"]
)
def test_foreign_bytes_under_every_suffix(tmp_path, run_map, plain, name, content):
    (tmp_path / name).write_bytes(content)
    refuse(tmp_path, run_map, plain(name), DataError)


def test_a_map_that_is_no_text_or_absent_or_deep(tmp_path):
    with pytest.raises(ConfigError, match="no such file"):
        import_run(tmp_path / "absent.toml", tmp_path / "out.h5")
    path = tmp_path / "map.toml"
    path.write_bytes(b"[log]\ntest = '\xff'\n")
    with pytest.raises(ConfigError, match="not UTF-8 text at byte 14"):
        import_run(path, tmp_path / "out.h5")
    path.write_text("a = " + "[" * 100_000)
    with pytest.raises(ConfigError, match="more than 64 levels deep"):
        import_run(path, tmp_path / "out.h5")


def test_pickles_are_never_loaded(tmp_path, run_map, plain):
    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "sprung"),)

    np.save(tmp_path / "a.npy", np.array([Trap()], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "a.npz", tx=np.array([Trap()], dtype=object), ax=np.arange(3.0))
    for name in ("a.npy", "a.npz"):
        refuse(tmp_path, run_map, plain(name), DataError)
    assert not (tmp_path / "sprung").exists()


def test_an_archive_that_claims_too_much_is_not_unpacked(tmp_path, run_map, plain):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (2**40,)})
    for name, extra in (("a.npz", b"\0" * 80), ("b.npz", b"\0" * 400 * 2**20)):
        with zipfile.ZipFile(tmp_path / name, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            archive.writestr("tx.npy", header.getvalue() + extra)
    assert "claims shape (1099511627776,)" in refuse(tmp_path, run_map, plain("a.npz"), DataError)
    assert "unpacks to" in refuse(tmp_path, run_map, plain("b.npz"), DataError)


def test_links_out_of_an_hdf5_source_are_not_followed(tmp_path, run_map, plain):
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["tx"] = np.arange(5.0)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["tx"] = h5py.ExternalLink("secret.h5", "/tx")
        file["ax"] = np.arange(5.0)
    assert "external" in refuse(tmp_path, run_map, plain("a.h5"), DataError)


def test_a_source_that_is_no_regular_file_is_not_opened(tmp_path, run_map, plain):
    os.mkfifo(tmp_path / "a.csv")
    assert "is not a file" in refuse(tmp_path, run_map, plain("a.csv"), DataError)


@pytest.mark.parametrize(
    "text", ["u[]", "u[:, x]", "u[1e3]", "u[::0]", "u[..., ...]", "u[0x1]", "u[:, 0", "u[1:2:3:4]"]
)
def test_selections_that_mean_nothing(text):
    try:
        selection = parse_selection(text)
    except ConfigError as error:
        assert text in str(error)
    else:
        assert selection.indices == () and selection.name == text  # taken as a plain name, which no file has
