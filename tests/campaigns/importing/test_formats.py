"""Every kind of source gives the same log, checked with plain h5py against the arrays that were written."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from campaigns.log import read_run, verify
from sim_backend.errors import ConfigError, DataError

STARTED = pytest.mark.usefixtures("started_readers")
"""For what the readers of every format below, each a process of its own, do not show."""


def write_csv(path: Path, data: dict[str, np.ndarray], delimiter: str = ",") -> None:
    np.savetxt(path, np.column_stack(list(data.values())), "%.17g", delimiter, header=delimiter.join(data), comments="")


def write_mat73(path: Path, data: dict[str, np.ndarray]) -> None:
    """What MATLAB writes: a 512-byte user block, column vectors (n, 1) stored as (1, n)."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in data.items():
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def write_h5(path: Path, data: dict[str, np.ndarray]) -> None:
    with h5py.File(path, "w") as file:
        for name, values in data.items():
            file[name] = values


WRITERS = {
    "a.csv": write_csv,
    "a.tsv": lambda path, data: write_csv(path, data, "\t"),
    "a.dat": lambda path, data: write_csv(path, data, " "),
    "a.txt": lambda path, data: write_csv(path, data, "\t"),
    "a.asc": lambda path, data: write_csv(path, data, ";"),
    "a.npz": lambda path, data: np.savez_compressed(path, **data),
    "a.mat": lambda path, data: scipy.io.savemat(path, data, do_compression=True),
    "b.mat": write_mat73,
    "a.h5": write_h5,
    "a.hdf5": write_h5,
}


@STARTED
@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_log_in_si(tmp_path, run_map, plain, data, name):
    WRITERS[name](tmp_path / name, data)
    report = run_map(plain(name))
    assert (report.rows, report.sample_rate_hz) == (500, 10_000.0)
    with h5py.File(tmp_path / "out.h5") as file:
        for channel, variable, unit in (("torque", "tx", "N m"), ("angle", "ax", "rad")):
            dataset = file["channels"][channel]
            assert dataset.attrs["unit"] == unit
            # one multiplication by 1e-3, so equal to two roundings; texts hold 17 digits, which are exact
            np.testing.assert_allclose(dataset[:], data[variable] * 1e-3, rtol=4e-16, atol=0.0)
    assert verify(tmp_path / "out.h5").ok


def test_npy_with_indices_and_no_name(tmp_path, run_map, plain, data):
    np.save(tmp_path / "a.npy", np.column_stack([data["tx"], data["ax"]]))
    text = plain("a.npy").replace('select = "tx"', 'select = "u[:, 0]"').replace('select = "ax"', 'select = "[:, -1]"')
    run_map(text)
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("angle"), data["ax"] * 1e-3, rtol=4e-16)
        np.testing.assert_allclose(run.read("torque"), data["tx"] * 1e-3, rtol=4e-16)


def test_text_without_names_is_selected_by_number_and_comments_are_skipped(tmp_path, run_map, plain):
    (tmp_path / "a.csv").write_text(
        "# free run\n\n1.5;2,5;x\n".replace(";x", "").replace("2,5", "2.5").replace(";", ",")
    )
    with (tmp_path / "a.csv").open("a") as stream:
        stream.write("3.5,4.5 # second\n")
    run_map(plain("a.csv").replace('"tx"', '"[:, 0]"').replace('"ax"', '"[:, 1]"'))
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("torque"), [1.5e-3, 3.5e-3], rtol=4e-16)
        np.testing.assert_allclose(run.read("angle"), [2.5e-3, 4.5e-3], rtol=4e-16)


def test_semicolons_and_decimal_commas(tmp_path, run_map, plain):
    (tmp_path / "a.csv").write_text("tx;ax\n1,5;2\n-0,25;3\n")
    run_map(plain("a.csv").replace("[channels.torque]", 'delimiter = ";"\ndecimal = ","\n[channels.torque]'))
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("torque"), [1.5e-3, -0.25e-3], rtol=4e-16)


def test_a_column_whose_name_looks_like_an_index_wins(tmp_path, run_map, plain):
    (tmp_path / "a.csv").write_text("u[0],ax\n1,5\n2,6\n")
    run_map(plain("a.csv").replace('"tx"', '"u[0]"'))
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("torque"), [1e-3, 2e-3], rtol=4e-16)


def test_fields_of_matlab_structures_and_groups(tmp_path, run_map, plain, data):
    scipy.io.savemat(tmp_path / "a.mat", {"rec": {"tx": data["tx"], "ax": data["ax"]}})
    with h5py.File(tmp_path / "b.mat", "w") as file:
        file["rec/tx"], file["rec/ax"] = data["tx"][None, :], data["ax"][None, :]
    for name in ("a.mat", "b.mat"):
        run_map(plain(name).replace('"tx"', '"rec.tx"').replace('"ax"', '"rec.ax"'))
        with read_run(tmp_path / "out.h5") as run:
            np.testing.assert_allclose(run.read("angle"), data["ax"] * 1e-3, rtol=4e-16)
        (tmp_path / "out.h5").unlink()


def test_both_matlab_versions_index_alike(tmp_path, run_map, plain):
    """A 3 x 200 matrix in MATLAB is u(2, :) there and u[1, :] here, however the file stores it."""
    matrix = np.random.default_rng(2).normal(size=(3, 200))
    scipy.io.savemat(tmp_path / "a.mat", {"u": matrix})
    write_mat73(tmp_path / "b.mat", {})
    with h5py.File(tmp_path / "b.mat", "r+") as file:
        file["u"] = matrix.T
    for name in ("a.mat", "b.mat"):
        run_map(plain(name).replace('"tx"', '"u[1, :]"').replace('"ax"', '"u[2, :]"'))
        with read_run(tmp_path / "out.h5") as run:
            np.testing.assert_allclose(run.read("torque"), matrix[1] * 1e-3, rtol=4e-16)
        (tmp_path / "out.h5").unlink()


COUNTS = """
[log]
test = "counter"
source = "{source}"
sample_rate_hz = 1000.0
[channels.command]
select = "u"
unit = "V"
role = "input"
[channels.angle]
select = "encoder"
unit = "{unit}"
role = "output"
{more}
"""


@pytest.mark.parametrize("kind", ["u2", "i2"])
@pytest.mark.parametrize("suffix", ["npz", "dat"])
def test_a_counter_of_16_bits_is_unwrapped_and_scaled(tmp_path, run_map, kind, suffix):
    turned = np.cumsum(np.random.default_rng(3).integers(-9_000, 11_000, 2_000))  # overflows both ways, a dozen times
    counts = turned.astype(kind)
    assert np.ptp(turned) > 10 * 65_536
    data = {"u": np.sin(np.arange(2_000.0)), "encoder": counts}
    if suffix == "npz":
        np.savez(tmp_path / "a.npz", **data)
    else:
        write_csv(tmp_path / "a.dat", data, " ")
    per_count = 2.0 * np.pi / 4096.0
    run_map(COUNTS.format(source=f"a.{suffix}", unit="rad", more=f"unwrap = 65536.0\nscale = {per_count!r}"))
    with read_run(tmp_path / "out.h5") as run:
        wanted = (turned - turned[0] + int(counts[0])) * per_count  # whole numbers of a double are exact
        np.testing.assert_allclose(run.read("angle"), wanted, rtol=1e-15, atol=0.0)


def test_a_counter_that_is_not_unwrapped_is_a_remark_and_a_wrong_range_is_refused(tmp_path, run_map):
    turned = 40 * np.arange(5_000)
    np.savez(tmp_path / "a.npz", u=np.sin(np.arange(5_000.0)), encoder=turned.astype("u2"))
    made = run_map(COUNTS.format(source="a.npz", unit="rad", more="scale = 0.001"))
    assert any("angle jumps by" in remark and "unwrap" in remark for remark in made.remarks)
    (tmp_path / "out.h5").unlink()
    for wrong in ("32768.0", "65.536"):
        with pytest.raises(
            DataError, match=f"readings that span {np.ptp(turned.astype('u2'))}, of at most .* unit of the source"
        ):
            run_map(COUNTS.format(source="a.npz", unit="rad", more=f"unwrap = {wrong}\nscale = 0.001"))


@pytest.mark.parametrize("unit", ["counts", "LSB", "ticks"])
def test_counts_are_no_unit_and_the_refusal_says_what_to_write(tmp_path, run_map, unit):
    np.savez(tmp_path / "a.npz", u=np.sin(np.arange(50.0)), encoder=np.arange(50))
    text = COUNTS.format(source="a.npz", unit=unit, more="scale = 0.001")
    with pytest.raises(ConfigError, match=r"not a physical unit.*how much of it one count is") as refused:
        run_map(text)
    assert "\n" not in str(refused.value)
    run_map(text.replace(f'"{unit}"', '"rad"'))
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("angle"), 0.001 * np.arange(50), rtol=1e-15)


def test_a_row_of_units_may_say_counts(tmp_path, run_map):
    rows = "".join(f"{0.1 * k:.1f};{7 * k}\n" for k in range(50))
    (tmp_path / "a.dat").write_text(f"u;encoder\nV;counts\n{rows}", encoding="utf-8")
    run_map(COUNTS.format(source="a.dat", unit="rad", more="scale = 0.001"))
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("angle"), 0.007 * np.arange(50), rtol=1e-14)
