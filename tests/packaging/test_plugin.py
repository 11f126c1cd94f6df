"""The template of a plug-in, built and installed as a user would, and used by real commands in real processes."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from campaigns.log import read_run
from sim_backend.model import EffectEntry, dump_model
from tests.running import REAL, mccd
from tests.small_bench import NOISE, bench_model

ROOT = Path(__file__).parents[2]
TEMPLATE = ROOT / "docs" / "examples" / "plugin"


def install(source: Path, site: Path) -> Path:
    """Build and install a package into a folder of its own, without a network."""
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
        + ["--disable-pip-version-check", "--target", str(site), str(source)],
        check=True,
        timeout=300,
    )
    return site


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plugin")
    shutil.copytree(TEMPLATE, folder / "source")  # a build leaves files beside its sources
    return install(folder / "source", folder / "site")


def run(site: Path, cwd: Path, *words: str) -> subprocess.CompletedProcess[str]:
    search = os.pathsep.join([str(site), str(ROOT)])
    return mccd(*words, cwd=cwd, env={"PYTHONPATH": search}, command=REAL, timeout=600.0)


def test_an_effect_is_listed_described_and_suggested(site: Path, tmp_path: Path) -> None:
    done = run(site, tmp_path, "model", "effects", "--json")
    assert done.returncode == 0, done.stderr
    assert "quadratic-stiffness" in [one["effect"] for one in json.loads(done.stdout)["effects"]]
    assert "N m/rad^2" in run(site, tmp_path, "model", "effects", "quadratic-stiffness").stdout
    done = run(site, tmp_path, "model", "effects", "quadratic-stifness")
    assert done.returncode == 2 and "did you mean quadratic-stiffness" in done.stderr
    assert mccd("model", "effects", "quadratic-stiffness").returncode == 2  # not installed here


def test_a_model_holds_an_effect_of_a_package_and_its_bench_shows_it(site: Path, tmp_path: Path) -> None:
    entry = EffectEntry(effect="quadratic-stiffness", where="theta_x", parameters={"stiffness": 200.0})
    settings = ["--set", "axes=['theta_x']", "--set", "steps_s=1.0", "--set", "noise_s=0.1", "--set", "held_out_s=0.1"]
    readings = []
    for name, effects in (("with", (entry, *NOISE)), ("without", NOISE)):
        (tmp_path / f"{name}.toml").write_text(dump_model(bench_model(effects)), encoding="utf-8")
        done = run(site, tmp_path, "simulate", "--model", f"{name}.toml", *settings, "--out", f"{name}.h5")
        assert done.returncode == 0, done.stderr
        with read_run(tmp_path / f"{name}.h5") as log:
            readings.append(log.read("theta_x"))
    assert np.mean(readings[0]) < np.mean(readings[1])  # pushed to one side, whichever way it is driven
    done = mccd("simulate", "--model", "with.toml", "--out", "c.h5", cwd=tmp_path)
    assert done.returncode == 2 and "no effect 'quadratic-stiffness'" in done.stderr


# a mirror by velocity Verlet, in steps much finer than the samples, on a spring with a part in the square
DIAGNOSED = """
import json
import numpy as np
import mccd
from sim_backend.model import parse_model

rate_hz, rng = 2000.0, np.random.default_rng(1)

def torque(seconds, size):
    n = int(seconds * rate_hz)
    return np.repeat(rng.uniform(-size, size, n // 400 + 1), 400)[:n] + 0.05 * size * rng.normal(size=n)

def mirror(torque_nm, quadratic=200.0, fine=16):
    inertia, stiffness, damping = 3.23e-4, 11.16, 3.0e-3
    dt, x, v, out = 1.0 / (fine * rate_hz), 0.0, 0.0, []
    def acceleration(t, x, v):
        return (t - stiffness * x - quadratic * x * x - damping * v) / inertia
    for t in torque_nm:
        out.append(x)
        for _ in range(fine):
            half = v + 0.5 * dt * acceleration(t, x, v)
            x += dt * half
            v = half + 0.5 * dt * acceleration(t, x, half)
    return np.array(out)

inputs = [torque(4.0, 0.05), torque(2.0, 0.035)]
outputs = [mirror(u) + 2e-7 * rng.normal(size=u.size) for u in inputs]
model = parse_model('''
schema = "mccd-model/1"
name = "nominal"
sample_rate_hz = 2000.0
inputs = [{ name = "torque", unit = "N m", dof = "theta" }]
outputs = [{ name = "theta", unit = "rad", dof = "theta" }]
[[modes]]
label = "suspension"
frequency_hz = 29.2
decay_rate_1_s = 4.8
input.torque = 3150.0
output.theta = 1.0
''', "test")
answer = mccd.diagnose(mccd.Arrays(inputs, outputs, rate_hz, held_out=[1]), model)
effects = [e.effect for e in answer.extended.core.effects]
print(json.dumps([answer.verdict, answer.to_frame().to_dict("records"), effects]))
"""


def test_a_diagnosis_names_an_effect_of_a_package_with_its_size(site: Path, tmp_path: Path) -> None:
    search = os.pathsep.join([str(site), str(ROOT)])
    done = subprocess.run(
        [sys.executable, "-c", DIAGNOSED],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": search},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    verdict, (row,), effects = json.loads(done.stdout)
    assert (verdict, row["effect"], row["parameter"]) == ("named", "quadratic-stiffness", "stiffness")
    assert effects == ["quadratic-stiffness"]
    # the fit takes four steps a sample where the mirror takes 16: an error of the order of (ω dt)² = 0.9 %
    assert abs(row["value"] - 200.0) < 4.0 * row["std"] + 0.01 * 200.0


def test_a_plan_is_listed_and_played(site: Path, tmp_path: Path) -> None:
    assert "pulse" in run(site, tmp_path, "campaign", "list", "--plans").stdout
    done = run(site, tmp_path, "simulate", "--plan", "pulse", "--set", "torque_nm=0.02", "--out", "pulse.h5")
    assert done.returncode == 0, done.stderr
    with read_run(tmp_path / "pulse.h5") as log:
        assert log.header.test == "pulse"
        torque = log.read("command_theta_x")
        assert torque.max() == pytest.approx(0.02)
        assert np.count_nonzero(torque > 0.01) == round(0.005 * log.sample_rate_hz)
    done = run(site, tmp_path, "simulate", "--plan", "pulse", "--set", "torque=1")
    assert done.returncode == 2 and "torque_nm" in done.stderr


def test_a_strategy_is_played_and_its_name_suggested(site: Path, tmp_path: Path) -> None:
    words = (
        "chop",
        "--strategy",
        "feedback-only",
        "--cycles",
        "2",
        "--set",
        "frequency_hz=2.0",
        "--set",
        "window_s=0.1",
    )
    done = run(site, tmp_path, *words, "--json")
    with read_run(tmp_path / "chop.h5") as log:
        assert log.status == "complete", done.stderr
        # by feedback alone it may be too slow for the requirements
        assert done.returncode == (0 if json.loads(done.stdout)["passed"] else 1)
        assert log.header.settings["strategy"] == "feedback-only"
        moved = np.ptp(log.read("theta_x"))
    assert moved > 8e-3
    done = run(site, tmp_path, "chop", "--strategy", "feedback-onl")
    assert done.returncode == 2 and "did you mean 'feedback-only'" in done.stderr


def test_an_importer_reads_its_suffix_with_units_and_its_refusal_is_told(site: Path, tmp_path: Path) -> None:
    values = [str((7919 * i) % 13) for i in range(50)]
    (tmp_path / "data.pairs").write_text(f"u [mN m]: {' '.join(values)}\n", encoding="utf-8")
    (tmp_path / "map.toml").write_text(
        '[log]\ntest = "x"\nsource = "data.pairs"\nsample_rate_hz = 100.0\n'
        '[channels.u]\nselect = "u"\nunit = "mN m"\nrole = "input"\n'
    )
    done = run(site, tmp_path, "import", "map.toml", "-o", "a.h5")
    assert done.returncode == 0, done.stderr
    with read_run(tmp_path / "a.h5") as log:
        np.testing.assert_allclose(log.read("u"), 1e-3 * np.array(values, dtype=float), rtol=1e-12)
    (tmp_path / "data.pairs").write_text("nothing of the kind\n", encoding="utf-8")
    done = run(site, tmp_path, "import", "map.toml", "-o", "b.h5")
    assert done.returncode == 4 and "is not a line 'name [unit]: values'" in done.stderr, done.stderr
    assert done.stderr.count("\n") == 1
    done = mccd("import", "map.toml", "-o", "b.h5", cwd=tmp_path, command=REAL)
    assert done.returncode == 4 and "suffix '.pairs'" in done.stderr


def installed(site: Path, module: str, code: str, name: str, group: str = "effects") -> Path:
    """Leave what pip leaves of a package that declares one thing."""
    (site / module).mkdir(parents=True)
    (site / module / "__init__.py").write_text(code + "\n")
    about = site / f"{module}-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1\n")
    (about / "entry_points.txt").write_text(f"[mccd.{group}]\n{name} = {module}:Thing\n")
    return site


@pytest.mark.parametrize(
    ("effect", "code", "says"),
    [
        ("broken", "import nothing_of_this_name", "cannot be imported (ModuleNotFoundError"),
        ("leaving", "import sys; sys.exit(0)", "cannot be imported (SystemExit: 0)"),
        ("number", "Thing = 3", "is not a subclass"),
        ("other", "from sim_backend.effects.cubic_stiffness import CubicStiffness as Thing", "calls itself"),
        ("cubic-stiffness", "Thing = 3", "has the name of one of mccd's own"),
    ],
)
def test_a_package_that_does_not_keep_its_promise_is_named(effect: str, code: str, says: str, tmp_path: Path) -> None:
    site = installed(tmp_path / "site", "bad_one", code, effect)
    done = run(site, tmp_path, "model", "effects")
    assert done.returncode == 2 and says in done.stderr and "bad_one" in done.stderr, done.stderr
    assert done.stderr.count("\n") == 1
    # what asks for none of it is not disturbed
    assert run(site, tmp_path, "model", "effects", "coulomb-friction").returncode == 0


def test_a_name_that_two_packages_declare_is_refused_with_both(tmp_path: Path) -> None:
    site = installed(tmp_path / "site", "one", "Thing = 3", "mine")
    installed(site, "two", "Thing = 3", "mine")
    done = run(site, tmp_path, "model", "effects")
    assert done.returncode == 2 and "package one" in done.stderr and "two" in done.stderr


STAGE = """
import numpy as np
from campaigns.strategies.stages import Stage
from sim_backend.bench import Gate
def stage(task, **changed):
    n, none = len(task.axes), np.zeros((task.period, len(task.axes)))
    usual = dict(label="chop", n_samples=None, reference=none, feedforward=none, feedback=(None,) * n, gates=())
    return Stage(**usual | changed)
"""


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("Thing = 3", "is not a function of a task and a design"),
        ("def Thing(task): return ()", "fails as a function of a task and a design (TypeError"),
        ("def Thing(task, design): raise SystemExit(0)", "(SystemExit: 0)"),
        ("def Thing(task, design): return 7", "(TypeError"),
        ("def Thing(task, design): return ()", "returns tuple, no list of stages"),
        ("def Thing(task, design): return [1]", "returns list, no list of stages"),
        ("def Thing(task, design): return stage(task)", "returns Stage, no list of stages"),
        ("def Thing(task, design): return [stage(task, feedback=(None,))]", "'chop' whose feedback"),
        ("def Thing(task, design): return [stage(task, feedback=(3, 3, 3))]", "'chop' whose feedback"),
        ("def Thing(task, design): return [stage(task, learning=(None,))]", "'chop' whose learning"),
        ("def Thing(task, design): return [stage(task, gates=(3,))]", "'chop' whose gates"),
        ("def Thing(task, design): return [stage(task, gates=(Gate(0, 3, True),))]", "'chop' whose gates"),
        ("def Thing(task, design): return [stage(task, reference=np.zeros(9))]", "'chop' whose reference"),
        ("def Thing(task, design): return [stage(task, feedforward=None)]", "'chop' whose feedforward"),
        ("def Thing(task, design): return [stage(task, n_samples=2.5)]", "'chop' whose n_samples"),
    ],
)
def test_a_strategy_that_returns_no_sound_stages_is_refused_by_name(code: str, says: str, tmp_path: Path) -> None:
    site = installed(tmp_path / "site", "bad_moves", STAGE + code, "odd", group="strategies")
    done = run(site, tmp_path, "chop", "--strategy", "odd", "--dry-run")
    assert done.returncode == 2 and says in done.stderr, done.stderr
    assert "'odd' of the package bad_moves" in done.stderr and done.stderr.count("\n") == 1
    assert done.stdout == ""
