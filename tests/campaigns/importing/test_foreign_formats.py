"""Formats in which numbers are packed, named with units, or kept by other programs; each written by its own library."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from campaigns.importing import foreign
from campaigns.importing.packing import unpacked
from campaigns.log import read_run
from sim_backend.errors import DataError
from tests.campaigns.importing.arrays import whole

COUNTS = np.arange(-20, 20, dtype=np.int16) * 37

STARTED = pytest.mark.usefixtures("started_readers")
"""For formats whose library test_formats.py starts in a reader of its own; those that stand here alone are started."""


def packed_h5(path: Path, **attributes: object) -> None:
    with h5py.File(path, "w") as file:
        file["tx"] = np.linspace(0.0, 1.0, 40)
        file["ax"] = COUNTS
        file["ax"].attrs.update(attributes)


def test_packed_numbers_are_unpacked(tmp_path, run_map, plain):
    packed_h5(tmp_path / "a.h5", scale_factor=2e-3, add_offset=0.5, _FillValue=np.int16(-32768))
    run_map(plain("a.h5"))
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("angle"), (COUNTS * 2e-3 + 0.5) * 1e-3, rtol=1e-14)


def test_a_missing_number_is_refused_unless_it_is_not_selected(tmp_path, run_map, plain):
    packed_h5(tmp_path / "a.h5", scale_factor=2e-3, _FillValue=COUNTS[5])
    with pytest.raises(DataError, match="nan at sample 5"):
        run_map(plain("a.h5"))
    run_map(plain("a.h5").replace('"tx"', '"tx[6:]"').replace('"ax"', '"ax[6:]"'))


def test_values_outside_of_the_valid_range_are_missing():
    found = unpacked(np.array([-5, 0, 7]), {"valid_min": -1, "valid_max": 5})
    np.testing.assert_array_equal(np.isnan(found), [True, False, True])
    np.testing.assert_array_equal(unpacked(COUNTS, {"units": "V"}), COUNTS)


def test_another_unit_than_the_map_says_is_refused(tmp_path, run_map, plain):
    packed_h5(tmp_path / "a.h5", units="urad")
    with pytest.raises(DataError, match="says that 'ax' is in urad, the map says mrad"):
        run_map(plain("a.h5"))
    with pytest.raises(DataError, match="says that 'ax' is in urad"):
        run_map(plain("a.h5").replace('"ax"', '"ax[:]"'))
    run_map(plain("a.h5").replace('role = "output"', 'role = "output"\nignore_file_unit = true'))


def test_a_unit_in_a_table_is_held_against_the_map(tmp_path, run_map, plain):
    (tmp_path / "a.csv").write_text("tx,ax\nmN m,urad\n0.5,1.5\n0.6,1.7\n")
    with pytest.raises(DataError, match="in urad, the map says mrad"):
        run_map(plain("a.csv"))


@STARTED
def test_classic_netcdf(tmp_path, run_map, plain):
    with scipy.io.netcdf_file(tmp_path / "a.nc", "w") as file:
        file.createDimension("time", 40)
        for name, values in (("tx", np.linspace(0.0, 1.0, 40)), ("ax", COUNTS)):
            variable = file.createVariable(name, values.dtype.char, ("time",))
            variable[:] = values
        file.variables["ax"].scale_factor = np.float64(2e-3)
        file.variables["ax"].units = "mrad"
    run_map(plain("a.nc"))
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("angle"), COUNTS * 2e-6, rtol=1e-14)


def test_fields_of_a_compound_dataset(tmp_path, run_map, plain):
    table = np.zeros(40, dtype=[("tx", "f8"), ("ax", "f4"), ("flag", "i2")])
    table["tx"], table["ax"] = np.linspace(0.0, 1.0, 40), COUNTS
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run/daq"] = table
    run_map(plain("a.h5").replace('"tx"', '"run/daq/tx"').replace('"ax"', '"run/daq/ax"'))
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("angle"), COUNTS * 1e-3, rtol=1e-14)


@STARTED
def test_tdms(tmp_path, run_map, plain, data):
    nptdms = pytest.importorskip("nptdms")
    channels = [
        nptdms.ChannelObject("DAQ", name, values, {"unit_string": "mrad"} if name == "ax" else {})
        for name, values in data.items()
    ]
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as file:
        file.write_segment(channels)
    text = plain("a.tdms").replace('"tx"', '"DAQ/tx"').replace('"ax"', '"DAQ/ax"')
    run_map(text)
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("angle"), data["ax"] * 1e-3, rtol=4e-16)
    (tmp_path / "out.h5").unlink()
    with pytest.raises(DataError, match="in mrad, the map says urad"):
        run_map(text.replace('unit = "mrad"', 'unit = "urad"'))
    (tmp_path / "b.tdms").write_bytes((tmp_path / "a.tdms").read_bytes()[:200])
    with pytest.raises(DataError):
        run_map(text.replace("a.tdms", "b.tdms"))


@STARTED
def test_parquet_with_dates(tmp_path, run_map, plain, data):
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    stamps = pd.Timestamp("2026-11-25 12:00") + pd.to_timedelta(np.arange(500) * 100, unit="us")
    pd.DataFrame({**data, "when": stamps}).to_parquet(tmp_path / "a.parquet")
    made = run_map(plain("a.parquet").replace("sample_rate_hz = 10000.0", 'time = "when"'))
    assert made.sample_rate_hz == pytest.approx(1e4)
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("angle"), data["ax"] * 1e-3, rtol=4e-16)


def test_counters_sums_and_columns_by_part(tmp_path, run_map):
    turn = np.cumsum(np.full(300, 0.13))
    np.savez(tmp_path / "a.npz", up=turn % 1.0, up2=turn[::-1] % 1.0, left=turn + 1.0, right=turn * 0.5)
    run_map(
        """
        [log]
        test = "a/b: 100 %, ü"
        source = "a.npz"
        sample_rate_hz = 100.0
        [channels.angle]
        select = "up"
        unit = "rad"
        role = "output"
        unwrap = 1.0
        [channels.mean]
        combine = { left = 0.5, right = 0.5 }
        unit = "m"
        role = "input"
        [[parts]]
        label = "up"
        [[parts]]
        label = "down"
        select = { angle = "up2" }
        """
    )
    with read_run(tmp_path / "out.h5") as run:
        assert run.header.test == "a/b: 100 %, ü"
        np.testing.assert_allclose(np.diff(run.window("up").read("angle")), 0.13, rtol=1e-9)
        np.testing.assert_allclose(np.diff(run.window("down").read("angle")), -0.13, rtol=1e-9)
        np.testing.assert_allclose(run.window("up").read("mean"), 0.75 * turn + 0.5, rtol=1e-14)


def matlabs_own_files() -> list[Path]:
    """Files that MATLAB 4 to 7.4 wrote, on several machines; scipy brings them for its own tests."""
    folder = Path(scipy.io.__file__).parent / "matlab/tests/data"
    return sorted(folder.glob("*.mat"))


@pytest.mark.skipif(not matlabs_own_files(), reason="this scipy came without its tests")
def test_files_of_matlab_itself_are_read_or_refused():
    """Function handles, objects, cells and sparse matrices beside the data are no hindrance."""
    read = set()
    for path in matlabs_own_files():
        try:
            source = foreign._source(path)  # noqa: SLF001
            for name in source.names():
                found = source.pieces(name)
                if found is not None and found.dtype.kind in "fiub" and whole(found).size > 0:
                    read.add(path.name)
        except DataError as error:
            assert path.name in str(error)
    numbers = ("testdouble_", "testmatrix_", "testminus_", "test3dmatrix_", "testmulti_")
    assert {path.name for path in matlabs_own_files() if path.name.startswith(numbers)} <= read
    own = next(path for path in matlabs_own_files() if path.name.startswith("testfunc_7.4"))
    assert foreign.MatSource(own).names() == ["testfunc"]


def test_attributes_that_are_no_numbers_are_refused(tmp_path, run_map, plain):
    packed_h5(tmp_path / "a.h5", scale_factor=np.array([2e-3]), valid_range=np.array([-1000, 1000]))
    run_map(plain("a.h5"))
    (tmp_path / "out.h5").unlink()
    packed_h5(tmp_path / "a.h5", scale_factor="two")
    with pytest.raises(DataError, match="scale_factor is 'two'"):
        run_map(plain("a.h5"))
