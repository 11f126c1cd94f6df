"""A bench that lacks a mode of the model: refused before anything moves, by the commands.

A controller knows whose logs it was designed from, and a design asks for sweeps of the bench that it is for.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import msgspec
import pytest

from campaigns.strategies.controller import DesignedFor, load_controller
from mccdcli.main import main
from sim_backend.model import dump_model, load_model
from tests.designed import designed

SWEEP = ["--plan", "sinesweep", "--set", "bands=[{start_hz=5.0, stop_hz=600.0, step_hz=5.0, gain=4.0, settle_s=0.2}]"]


@pytest.fixture
def lacking(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the model of the bench as built without its mode at 490 Hz."""
    model = load_model("as-built")
    modes = [mode for mode in model.modes if "490" not in mode.label]
    assert len(modes) == len(model.modes) - 1
    (tmp_path / "no-490.toml").write_text(dump_model(msgspec.structs.replace(model, modes=modes)), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", ["sim", "emulator"])
def test_a_controller_is_not_played_on_another_bench(lacking, capsys, kind):
    controller = designed() / "design" / "controller.toml"
    assert load_controller(controller).bench == DesignedFor(name="as-built")
    given = ["settle", "--strategy", "designed", "--controller", str(controller), "--bench", f"{kind}:no-490.toml"]
    assert main(given) == 2
    said = capsys.readouterr().err
    assert "was designed for the bench 'as-built', this is 'no-490'" in said and "design one for this bench" in said
    assert [path.name for path in lacking.iterdir()] == ["no-490.toml"]


def test_who_takes_the_bench_out_of_the_file_may_try_it(lacking):
    shutil.copy(designed() / "design" / "controller.toml", "controller.toml")
    text = Path("controller.toml").read_text(encoding="utf-8")
    assert '[bench]\nname = "as-built"\n' in text
    Path("controller.toml").write_text(text.replace('[bench]\nname = "as-built"\n', ""), encoding="utf-8")
    given = ["settle", "--strategy", "designed", "--controller", "controller.toml", "--bench", "sim:no-490.toml"]
    assert main([*given, "--dry-run"]) == 0


def test_a_model_that_no_sweep_confirms_is_not_designed_on(lacking, capsys):
    assert main(["design", "--model", "design", "--bench", "sim:no-490.toml"]) == 2
    said = capsys.readouterr().err
    assert "no log sweeps theta_x and theta_y" in said and "--unswept" in said
    assert [path.name for path in lacking.iterdir()] == ["no-490.toml"]


def test_its_own_sweeps_refuse_the_model_and_those_of_another_bench_are_refused(lacking, capsys):
    for axis in ("theta_x", "theta_y"):
        chosen = [*SWEEP, "--set", f"axis='{axis}'"]
        for model in ("no-490.toml", "as-built"):
            assert main(["simulate", "--model", model, *chosen, "-o", f"{Path(model).stem}-{axis}.h5"]) == 0

    def refused(*stems: str) -> str:
        logs = [part for stem in stems for part in ("--log", f"{stem}.h5")]
        assert main(["design", "--model", "design", "--bench", "sim:no-490.toml", *logs, "-o", "made"]) == 2
        assert not Path("made/controller.toml").exists()
        return capsys.readouterr().err

    assert "learning below" in refused("no-490-theta_x", "no-490-theta_y")
    assert "the logs are of the bench 'as-built'" in refused("as-built-theta_x", "as-built-theta_y")
    assert "design from the logs of one bench" in refused("as-built-theta_x", "no-490-theta_y")
