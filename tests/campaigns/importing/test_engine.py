"""What an import makes of clocks, units, segments, parts and arrays of several axes."""

import json
from pathlib import Path

import numpy as np
import pytest

from campaigns.importing import import_run
from campaigns.log import read_run
from campaigns.version import tool_commit
from sim_backend.errors import ConfigError
from tests.measured import MIRROR, needs_mirror

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "fsm-import.toml"


@pytest.mark.usefixtures("started_readers")
def test_the_map_of_the_contract_works_word_for_word(tmp_path, run_map):
    rng = np.random.default_rng(4)
    torque, angle = rng.normal(size=80_000), rng.normal(size=80_000)
    np.savetxt(tmp_path / "data.csv", np.column_stack([torque, angle]), "%.17g", ",", header="tx,ax", comments="")
    report = run_map(
        """
        [log]
        test = "free-run"
        source = "data.csv"          # csv, tsv, npy, npz, mat (v5 and v7.3), h5
        sample_rate_hz = 10000.0
        period = 10000
        [channels.torque]
        select = "tx"
        unit = "N m"
        role = "input"
        dof = "theta_x"
        scale = 1.0
        [segments]
        "sweep up" = [0, 40000]
        "held-out" = [40000, 80000]
        """
    )
    assert [(part.label, part.start, part.stop) for part in report.segments] == [
        ("sweep up", 0, 40_000),
        ("held-out", 40_000, 80_000),
    ]
    with read_run(tmp_path / "out.h5") as run:
        assert run.header.test == "free-run"
        assert dict(run.header.bench) == {"kind": "imported", "name": "imported"}
        assert [part.held_out for part in run.segments] == [False, True]
        assert run.segments[0].settings["period_samples"] == 10_000
        np.testing.assert_array_equal(run.window("held-out").read("torque"), torque[40_000:])


def test_source_and_map_are_remembered(tmp_path, run_map, plain, data):
    import hashlib

    np.savez(tmp_path / "a.npz", **data)
    run_map(plain("a.npz"))
    with read_run(tmp_path / "out.h5") as run:
        configuration = json.loads(run.header.configuration)
    digest = hashlib.sha256((tmp_path / "a.npz").read_bytes()).hexdigest()
    assert run.header.tool_commit == tool_commit()
    assert configuration["sources"] == [{"file": "a.npz", "sha256": digest}]
    assert 'unit = "mN m"' in configuration["map"]


def test_scale_and_units_with_an_offset(tmp_path, run_map, plain, data):
    np.savez(tmp_path / "a.npz", **data)
    run_map(plain("a.npz").replace('unit = "mrad"', 'unit = "degC"\nscale = 2.0'))
    with read_run(tmp_path / "out.h5") as run:
        assert run.channels["angle"].unit == "K"
        np.testing.assert_allclose(run.read("angle"), 2.0 * data["ax"] + 273.15, rtol=4e-16)


@pytest.mark.parametrize("rate_hz", [10_000.0, 6400.0, 3.0])
def test_the_rate_from_time_stamps_of_two_digits_below_a_period(tmp_path, run_map, plain, data, rate_hz):
    digit = 10.0 ** np.floor(np.log10(0.01 / rate_hz))
    stamps = np.round((2.5 + np.arange(500) / rate_hz) / digit) * digit
    np.savez(tmp_path / "a.npz", t=stamps, **data)
    report = run_map(plain("a.npz").replace("sample_rate_hz = 10000.0", 'time = "t"'))
    # both ends are off by at most half a digit, over 499 periods
    assert report.sample_rate_hz == pytest.approx(rate_hz, rel=digit * rate_hz / 499)
    assert report.channels[0].t0_s == stamps[0]


def test_axes_in_any_order_become_samples_within_periods_within_realisations(tmp_path, run_map):
    """Each value tells its own place, so that the order in the log can be read off it."""
    realisation, channel, period, sample = np.meshgrid(
        np.arange(3), np.arange(2), np.arange(4), np.arange(50), indexing="ij"
    )
    place = sample + 100.0 * period + 10_000.0 * realisation + 1e6 * channel
    np.savez(tmp_path / "a.npz", u=place, v=place.transpose(3, 1, 0, 2))
    for variable, axes, selection in (
        ("u", '["realisation", "period", "sample"]', "u[:, 1]"),
        ("v", '["sample", "realisation", "period"]', "v[:, 1]"),
    ):
        report = run_map(
            f"""
            [log]
            test = "multisine"
            source = "a.npz"
            sample_rate_hz = 100.0
            axes = {axes}
            [channels.{variable}]
            select = "{selection}"
            unit = "V"
            role = "aux"
            """
        )
        assert [part.label for part in report.segments] == ["realisation 0", "realisation 1", "realisation 2"]
        assert report.segments[1].settings == {"period_samples": 50, "periods": 4, "realisation": 1}
        with read_run(tmp_path / "out.h5") as run:
            rows = run.window("realisation 2").read(variable)
        np.testing.assert_array_equal(rows.reshape(4, 50), place[2, 1])
        (tmp_path / "out.h5").unlink()


def test_parts_follow_one_another(tmp_path, run_map):
    first, second = np.arange(5.0), np.arange(7.0) + 10.0
    np.save(tmp_path / "first.npy", first)
    np.savez(tmp_path / "second.npz", x=second)
    report = run_map(
        """
        log = { test = "two files", sample_rate_hz = 10.0 }
        [channels.x]
        select = "x"
        unit = "m"
        role = "output"
        [[parts]]
        label = "fit"
        source = "first.npy"
        settings = { level_v = 0.1 }
        [[parts]]
        label = "held-out"
        source = "second.npz"
        """
    )
    assert [(part.label, part.start, part.stop) for part in report.segments] == [("fit", 0, 5), ("held-out", 5, 12)]
    assert report.segments[0].settings == {"level_v": 0.1}
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_array_equal(run.read("x"), np.concatenate([first, second]))


def test_rows_outside_segments_and_segments_out_of_order(tmp_path, run_map, plain, data):
    np.savez(tmp_path / "a.npz", **data)
    run_map(plain("a.npz") + "[segments]\nlate = [300, 400]\nearly = [10, 20]\n")
    with read_run(tmp_path / "out.h5") as run:
        assert [part.label for part in run.segments] == ["early", "late"]
        assert run.rows == 500
        np.testing.assert_array_equal(run.window("late").read("torque"), run.read("torque")[300:400])


def test_a_constant_channel_may_be_allowed_and_a_reference_is_constant_at_will(tmp_path, run_map, plain, data):
    np.savez(tmp_path / "a.npz", tx=np.zeros(500), ax=np.ones(500))
    text = plain("a.npz").replace('role = "output"', 'role = "reference"')
    run_map(text.replace('role = "input"', 'role = "input"\nallow_constant = true'))
    with read_run(tmp_path / "out.h5") as run:
        assert not run.read("torque").any()


def test_an_existing_log_is_never_overwritten(tmp_path, run_map, plain, data):
    np.savez(tmp_path / "a.npz", **data)
    (tmp_path / "out.h5").write_text("precious")
    with pytest.raises(ConfigError, match="never overwrites"):
        run_map(plain("a.npz"))
    assert (tmp_path / "out.h5").read_text() == "precious"


@needs_mirror
def test_the_example_map_imports_the_measured_mirror(tmp_path):
    text = EXAMPLE.read_text(encoding="utf-8")
    (tmp_path / "map.toml").write_text(text.replace('= "u_', f'= "{MIRROR}/u_').replace('= "y_', f'= "{MIRROR}/y_'))
    report = import_run(tmp_path / "map.toml", tmp_path / "fsm.h5", allow_outside=True)
    assert report.rows == 3 * (6 + 3) * 2 * 8192  # levels x (train + test realisations) x periods x samples
    assert len(report.segments) == 27
    assert sum(part.held_out for part in report.segments) == 9
    with read_run(tmp_path / "fsm.h5") as run:
        for label, file in (("300 mV realisation 5", "300mV_train"), ("held-out 100 mV realisation 2", "100mV_test")):
            window, realisation = run.window(label), int(label[-1])
            assert window.settings["periods"] == 2
            for channel in range(3):
                for name, array in ((f"drive_{channel + 1}", "u"), (f"displacement_{channel + 1}", "y")):
                    source = np.load(MIRROR / f"{array}_{file}.npy")
                    for period in range(2):
                        rows = window.read(name)[8192 * period : 8192 * (period + 1)]
                        np.testing.assert_array_equal(rows, source[:, channel, realisation, period])
