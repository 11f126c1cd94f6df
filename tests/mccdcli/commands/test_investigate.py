"""`mccd investigate` as its users run it: result, exit codes, and one line for every mistake."""

from __future__ import annotations

import json

import msgspec
import pytest

from sim_backend.model import dump_model
from tests.small_bench import NOISE, bench_model

QUICK = (
    "--first multisine --set axes=['theta_x'] --set realisations=1 --set period_s=0.5 --set start_hz=2.0 "
    "--set stop_hz=500.0"
).split()


@pytest.fixture
def files(tmp_path):
    """The files of a bench with noise alone, and of its nominal model."""
    paths = tmp_path / "bench.toml", tmp_path / "nominal.toml"
    for path, effects in zip(paths, (NOISE, ()), strict=True):
        model = msgspec.structs.replace(bench_model(effects), sample_rate_hz=2000.0)
        path.write_text(dump_model(model), encoding="utf-8")
    return paths


@pytest.mark.parametrize("kind", ["sim", "emulator"])
def test_a_bench_that_is_as_its_model_ends_with_0(mccd, tmp_path, files, kind):
    bench, nominal = files
    out = tmp_path / "out"
    done = mccd("investigate", "--bench", f"{kind}:{bench}", "--model", str(nominal), "-o", str(out), "--json", *QUICK)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["verdict"] == "consistent" and found["paused"] is False
    assert [r["plan"] for r in found["rounds"]] == ["multisine"]
    assert (out / found["rounds"][0]["log"]).is_file()
    assert (out / "round-1" / "diagnosis" / "index.html").is_file()
    assert "round 1: consistent" in done.stderr


def test_a_dry_run_says_what_the_first_plan_takes_and_moves_nothing(mccd, tmp_path, files):
    bench, nominal = files
    done = mccd("investigate", "--bench", f"sim:{bench}", "--model", str(nominal), "--dry-run", "--json", "-o", "out")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["runs"]["multisine"]["duration_s"] == 9.0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bench.toml", "nominal.toml"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--set", "periods=3"], "--first"),
        (["--first", "multisines"], "there is no plan 'multisines'"),
        (["--first", "multisine", "--set", "torques=3"], "torque_rms_nm"),
        (["--without", "gremlins"], "there is no effect 'gremlins'"),
    ],
)
def test_a_mistake_is_told_in_one_line_and_nothing_moves(mccd, tmp_path, files, arguments, says):
    bench, nominal = files
    out = tmp_path / "out"
    done = mccd("investigate", "--bench", f"sim:{bench}", "--model", str(nominal), "-o", str(out), *arguments)
    assert done.returncode == 2
    assert says in done.stderr and "Traceback" not in done.stderr
    assert not list(out.glob("**/*.h5"))
