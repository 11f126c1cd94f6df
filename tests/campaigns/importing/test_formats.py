"""Every kind of source gives the same log, checked with plain h5py against the arrays that were written."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from campaigns.log import read_run, verify

STARTED = pytest.mark.usefixtures("started_readers")
"""For what the readers of every format below, each a process of its own, do not show."""


def write_csv(path: Path, data: dict[str, np.ndarray], delimiter: str = ",") -> None:
    np.savetxt(
        path, np.column_stack([data["tx"], data["ax"]]), "%.17g", delimiter, header=delimiter.join(data), comments=""
    )


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
