"""`import mccd`: what it costs, and every verb with its results against numbers that the test has put in."""

from __future__ import annotations

import html
import json
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import control
import msgspec
import numpy as np
import pytest
from matplotlib.figure import Figure

import mccd
import sim_backend.model
from campaigns.log import read_run
from sim_backend.model import EffectEntry, dump_model
from tests.small_bench import NOISE, bench_model

SWEEP = {
    "axis": "theta_x",
    "bands": [{"start_hz": 10.0, "stop_hz": 60.0, "step_hz": 5.0, "settle_s": 0.8, "measure_s": 0.4}],
}
FREE = {"axes": ["theta_x", "theta_y"], "steps_s": 1.5, "noise_s": 1.0, "held_out_s": 0.8}


@pytest.fixture(scope="module")
def swept() -> Iterator[mccd.Run]:
    with mccd.simulate(bench_model(NOISE), "sinesweep", SWEEP, seed=3, note="soft mount") as run:
        yield run


def test_importing_it_loads_nothing_heavy_and_every_name_is_there() -> None:
    script = (
        "import json, sys; import mccd; loaded = sorted(sys.modules); "
        "missing = [n for n in mccd.__all__ if not hasattr(mccd, n)]; print(json.dumps([loaded, missing, dir(mccd)]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=100, check=True)
    loaded, missing, listed = json.loads(done.stdout)
    roots = {name.partition(".")[0] for name in loaded}
    assert not roots & {"numpy", "h5py", "pandas", "scipy", "matplotlib", "control", "analysis", "campaigns", "numba"}
    assert missing == []
    assert set(mccd.__all__) < set(listed)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = mccd.nothing


def test_a_run_is_what_its_log_holds(swept: mccd.Run, tmp_path: Path) -> None:
    assert (swept.test, swept.status, swept.note) == ("sinesweep", "complete", "soft mount")
    assert swept.settings["axis"] == "theta_x"
    with read_run(swept.path) as log:
        expected = log.read("theta_x")
        np.testing.assert_array_equal(swept.read("theta_x"), expected)
        np.testing.assert_array_equal(swept.to_frame()["theta_x"], expected)
        np.testing.assert_array_equal(swept.to_xarray().theta_x, expected)
    assert swept.to_frame().attrs["units"]["theta_x"] == swept.to_xarray().theta_x.attrs["units"] == "rad"
    assert swept.time_s().shape == (swept.rows,)
    figure = swept.plot()
    assert isinstance(figure, Figure) and len(figure.axes) == len(swept.channels)
    assert "theta_x" in swept._repr_html_() and "soft mount" in swept._repr_html_()


def test_a_simulation_is_kept_where_it_is_named_and_else_goes_with_its_run(tmp_path: Path) -> None:
    short = {"axes": ["theta_x"], "steps_s": 0.1, "noise_s": 0.1, "held_out_s": 0.1}
    with mccd.simulate("design", "freerun", short, seed=1) as passing:
        first, folder = passing.read("theta_x"), passing.path.parent
        assert folder.exists()
    assert not folder.exists()
    with mccd.simulate("design", "freerun", short, seed=1, out=tmp_path / "a.h5") as kept:
        np.testing.assert_array_equal(kept.read("theta_x"), first)
    with mccd.read_run(tmp_path / "a.h5") as again:
        assert again.run_uid == kept.run_uid
    with pytest.raises(mccd.MccdError, match="never overwrites"):
        mccd.simulate("design", "freerun", short, out=tmp_path / "a.h5")
    with pytest.raises(mccd.MccdError, match="no plan 'nothing'"):
        mccd.simulate("design", "nothing")


def test_a_model_as_table_response_control_and_file(tmp_path: Path) -> None:
    content = bench_model(hardware=False)
    (tmp_path / "a.toml").write_text(dump_model(content), encoding="utf-8")
    model = mccd.load_model(tmp_path / "a.toml")
    frame = model.to_frame()
    assert frame.loc["theta_x", "frequency_hz"] == 29.6
    assert frame.loc["theta_x", "zeta"] == pytest.approx(4.7 / (2.0 * math.pi * 29.6))
    assert math.isnan(frame.loc["theta_x", "frequency_std_hz"])
    f = np.array([1.0, 29.6, 200.0])
    expected = content.linear().frequency_response(f)
    np.testing.assert_array_equal(model.frequency_response(f), expected)
    response = model.to_xarray(f)
    assert response.sel(output="theta_x", input="torque_x").values == pytest.approx(expected[:, 0, 0])
    system = model.to_control()
    assert isinstance(system, control.StateSpace) and system.input_labels == list(model.inputs)
    for k, hz in enumerate(f):
        np.testing.assert_allclose(system(2j * math.pi * hz), expected[k], rtol=1e-9, atol=1e-15)
    assert len(model.plot().axes) == 2 * 9
    assert "29.6" in model._repr_html_()
    model.save(tmp_path / "b.toml")
    assert mccd.load_model(tmp_path / "b.toml").core == model.core
    with pytest.raises(mccd.MccdError, match="would be overwritten"):
        model.save(tmp_path / "b.toml")
    assert mccd.load_model((tmp_path / "b.toml").read_text(encoding="utf-8")).core == model.core
    with pytest.raises(mccd.MccdError, match="the given text"):
        mccd.load_model("name = 1\n")
    assert mccd.load_model("design").core == sim_backend.model.load_model("design")


def test_identify_finds_the_mode_that_the_bench_has(swept: mccd.Run) -> None:
    found = mccd.identify(swept, modes=1)
    (row,) = found.to_frame().itertuples()
    assert abs(row.frequency_hz - 29.6) < 4.0 * row.frequency_std_hz + 0.01
    assert row.zeta == pytest.approx(4.7 / (2.0 * math.pi * 29.6), rel=0.03)
    measured = found.to_xarray()["theta_x", "command_theta_x"]
    assert measured.frequency.size == 11
    figure = found.plot()
    dots = next(line for line in figure.axes[0].get_lines() if line.get_label() == "measured")
    np.testing.assert_array_equal(dots.get_xdata(), measured.frequency)
    assert isinstance(found.to_control(), control.StateSpace)
    assert "stepped sine" in found._repr_html_()
    assert mccd.identify([str(swept.path)], modes=1).to_frame().equals(found.to_frame())


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> mccd.Diagnosis:
    friction = EffectEntry(effect="coulomb-friction", where="theta_x", parameters={"torque": 1e-3})
    out = tmp_path_factory.mktemp("diagnosed") / "free.h5"
    slower = {"sample_rate_hz": 2000.0}  # a fifth of the samples: it is diagnosed sooner
    bench = msgspec.structs.replace(bench_model((friction, *NOISE)), **slower)
    run = mccd.simulate(bench, "freerun", FREE, seed=5, out=out)
    return mccd.diagnose(run, msgspec.structs.replace(bench_model(hardware=False), **slower))


def test_a_diagnosis_as_table_arrays_model_and_files(answer: mccd.Diagnosis, tmp_path: Path) -> None:
    assert answer.verdict == "named" and answer.causes[0].effect == "coulomb-friction"
    row = answer.to_frame().set_index("parameter").loc["torque"]
    assert (row["effect"], row["where"], row["unit"]) == ("coulomb-friction", "theta_x", "N m")
    assert abs(row["value"] - 1e-3) < 4.0 * row["std"] + 1e-5
    data = answer.to_xarray()
    assert data.before.shape == data.after.shape == data.output.shape
    held = answer.gain
    assert held is not None and held.rms_after < held.rms_before
    x = list(data.output_channel.values).index("theta_x")
    assert float((data.after[:, x] ** 2).mean()) < float((data.before[:, x] ** 2).mean())
    figure = answer.plot()
    labels = [line.get_label() for line in figure.axes[0].get_lines()]
    assert len(figure.axes) == 3 and labels == ["nominal model", "extended model"]
    assert [e.effect for e in answer.extended.core.effects] == ["coulomb-friction"]
    assert isinstance(answer.to_control(), control.StateSpace)
    assert answer.sentence in html.unescape(answer._repr_html_())
    files = answer.write(tmp_path / "out")
    assert json.loads(files["diagnosis.json"].read_text())["verdict"] == "named"
    assert mccd.load_model(files["extended.toml"]).core.effects == answer.extended.core.effects


def test_records_of_another_shape_are_refused(answer: mccd.Diagnosis) -> None:
    data = answer.found.data

    with pytest.raises(mccd.MccdError, match="the model needs"):
        mccd.diagnose(mccd.Arrays(data.records[0].u[:, :1], data.records[0].y, data.rate_hz), answer.nominal)


def test_markup_in_a_file_is_text_in_a_notebook(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>"
    short = {"axes": ["theta_x"], "steps_s": 0.1, "noise_s": 0.1, "held_out_s": 0.1}
    with mccd.simulate("design", "freerun", short, note=evil) as run:
        assert evil not in run._repr_html_() and "&lt;script&gt;" in run._repr_html_()


def test_a_design_as_table_control_and_file(tmp_path: Path) -> None:
    with mccd.simulate("as-built", "rest", seed=2) as rest:
        designed = mccd.design("design", rest, unswept=True)
    assert designed.axes == ("theta_x", "theta_y")
    table = designed.to_frame()
    assert list(table.columns) == ["axis", "expected", "value", "limit"]
    loops = designed.to_control()
    f = np.array([10.0, 100.0])
    for one in designed.found.axes:
        made = one.feedback.controller
        z = np.exp(2j * math.pi * f / made.rate_hz)
        assert loops[one.dof].dt == pytest.approx(1.0 / made.rate_hz)
        np.testing.assert_allclose(loops[one.dof](z), made.frequency_response(f), rtol=1e-6)
    assert isinstance(designed.plot(), Figure) and "stability" in designed._repr_html_()
    assert designed.to_xarray()["theta_x"].torque.attrs["units"] == "N m"
    assert designed.save(tmp_path / "c.toml").exists()


def test_a_design_is_refused_for_another_bench_and_for_two_moves() -> None:
    short = {"duration_s": 0.1, "settle_s": 0.1}
    with mccd.simulate("design", "rest", short) as rest:
        assert rest.log.header.bench["name"] == "design"
        with pytest.raises(mccd.MccdError, match="the logs are of the bench 'design', .* is 'as-built'"):
            mccd.design("design", rest, unswept=True)
        with pytest.raises(mccd.MccdError, match="settling_s and max_power_w both choose the move"):
            mccd.design("design", rest, settling_s=5e-3, max_power_w=0.1, unswept=True)
        with pytest.raises(mccd.MccdError, match="tolerance of frequency is 0.7"):
            mccd.design("design", rest, bench="sim:design", tolerance=0.7, unswept=True)


def test_a_simulated_bench_has_the_name_of_its_file(tmp_path: Path) -> None:
    file = mccd.load_model("design").save(tmp_path / "mine.toml")
    with mccd.simulate(file, "rest", {"duration_s": 0.01, "settle_s": 0.01}) as run:
        assert run.log.header.bench["name"] == "mine"
    with mccd.simulate("table-6.4-30", "rest", {"duration_s": 0.01, "settle_s": 0.01}) as run:
        assert run.log.header.bench["name"] == "table-6.4-30"
