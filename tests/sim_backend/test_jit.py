"""Kernels are compiled when they are called, kept with all that decides on them, and never taken for another's."""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from sim_backend import jit, kernel_cache
from sim_backend.effects import BENCH_ONLY, NAMED, NOISES
from sim_backend.jit import Deferred, njit
from sim_backend.kernel_cache import VARIABLE, KernelCacheWarning

KERNEL = """
from sim_backend.jit import njit
FACTOR = {factor}

@njit
def inner(x):
    return FACTOR * x {more}

@njit
def outer(x):
    return inner(x) + 1.0
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "kernels"))
    monkeypatch.setattr(kernel_cache, "_told", set())
    return tmp_path / "kernels"


def module(factor: float = 2.0, more: str = "") -> ModuleType:
    """A module with two kernels, always of the same name and in the same lines."""
    made = ModuleType("kernels_of_a_test")
    exec(compile(KERNEL.format(factor=factor, more=more), "kernels_of_a_test.py", "exec"), made.__dict__)
    return made


def test_a_kernel_is_python_until_it_is_called() -> None:
    script = (
        "import json, sys\n"
        "from sim_backend.jit import njit\n"
        "double = njit(lambda x: 2.0 * x)\n"
        "before = 'numba' in sys.modules\n"
        "print(json.dumps([before, double(3.0), 'numba' in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120)
    assert json.loads(done.stdout) == [False, 6.0, True]


def test_an_entry_is_named_by_all_versions_without_importing_numba() -> None:
    script = (
        "import json, sys\n"
        "from sim_backend.jit import entry_name\n"
        "print(json.dumps([entry_name('a', 'b'), 'numba' in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120)
    assert json.loads(done.stdout) == [jit.entry_name("a", "b"), False]
    assert jit.entry_name("a", "b") != jit.entry_name("a", "c")


def test_what_is_kept_is_used_and_goes_by_globals_and_called_kernels(folder: Path) -> None:
    assert module().outer(3.0) == 7.0
    kept = sorted(entry.name for entry in folder.iterdir())
    again = module()
    assert again.outer(3.0) == 7.0
    assert sum(again.outer.made.stats.cache_hits.values()) == 1
    assert sorted(entry.name for entry in folder.iterdir()) == kept
    # another global and another called kernel, with the function's own code and place the same
    assert module(factor=5.0).outer(3.0) == 16.0
    assert module(more="- 1.0").outer(3.0) == 6.0
    assert module().outer(3.0) == 7.0


def test_other_types_are_other_entries() -> None:
    for _ in range(2):
        made = module()
        assert made.outer(3) == 7.0
        np.testing.assert_array_equal(made.outer(np.array([1.0, 2.0])), [3.0, 5.0])
        assert made.outer(1j) == 1.0 + 2.0j


def test_a_damaged_entry_is_compiled_again(folder: Path) -> None:
    module().outer(3.0)
    for entry in folder.iterdir():
        whole = bytearray(entry.read_bytes())
        whole[len(whole) // 2] ^= 4
        entry.write_bytes(whole)
    with pytest.warns(KernelCacheWarning, match="damaged"):
        assert module().outer(3.0) == 7.0


def test_processes_that_fill_one_cache_at_once_compute_the_same(folder: Path) -> None:
    script = (
        "import numpy as np\n"
        "from analysis.linear.simulate import simulate_linear\n"
        "from sim_backend.linear import discretise\n"
        "from sim_backend.model import load_model\n"
        "model = discretise(load_model('design').linear(), 10e3)\n"
        "u = np.random.default_rng(1).standard_normal((2000, 3))\n"
        "print(simulate_linear(model, u).tobytes().hex()[:4096])"
    )
    started = [
        subprocess.Popen([sys.executable, "-W", "error", "-c", script], stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    printed = [process.communicate(timeout=300)[0] for process in started]
    assert [process.returncode for process in started] == [0] * 4
    assert len(set(printed)) == 1 and len(printed[0]) > 4000
    assert list(folder.glob(".new-*")) == []


def test_deferred_values_are_found_inside_kernels() -> None:
    tau = Deferred("math", "tau")
    made = ModuleType("deferred_of_a_test")
    made.__dict__.update(tau=tau, njit=njit)
    exec("@njit\ndef turns(x):\n    return x / tau", made.__dict__)
    assert made.turns(np.pi) == 0.5


def test_no_kernel_compiles_the_text_of_an_error(folder: Path) -> None:
    # an array written to another one brings it, and with it numba's texts: 4 s, many times what the kernel takes
    script = (
        "import json, numpy as np\n"
        "from numba.core import event\n"
        "from analysis.diagnosis.noise.whitener import _fir\n"
        "from analysis.identification.block_basis import exponentials\n"
        "from analysis.linear.simulate import simulate_linear\n"
        "from sim_backend.linear import discretise\n"
        "from sim_backend.model import load_model\n"
        "with event.install_recorder('numba:compile') as made:\n"
        "    simulate_linear(discretise(load_model('design').linear(), 10e3), np.ones((20, 3)))\n"
        "    exponentials(np.zeros((1, 2, 2)))\n"
        "    _fir(np.ones(2), np.ones((1, 5)), np.empty((1, 5)))\n"
        "print(json.dumps([one.data['dispatcher'].py_func.__module__ for _, one in made.buffer]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=300)
    modules = json.loads(done.stdout)
    assert {"analysis.linear.simulate", "analysis.identification.block_basis"} <= set(modules)
    assert "numba.cpython.unicode" not in modules


def every_stamp() -> dict[str, str]:
    """The stamps of all kernels of the project."""
    found = {}
    for package in ("sim_backend", "campaigns", "analysis"):
        for info in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
            if info.name.endswith("__main__"):
                continue
            for name, value in vars(importlib.import_module(info.name)).items():
                if isinstance(value, jit.Kernel | jit.Callback) and value.__module__ == info.name:
                    found[f"{info.name}.{name}"] = value.stamp()
    return found


def test_the_same_kernel_has_the_same_stamp_in_every_process() -> None:
    script = "import json; from tests.sim_backend.test_jit import every_stamp; print(json.dumps(every_stamp()))"
    stamps = []
    for seed in ("1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", script],
            capture_output=True,
            text=True,
            timeout=120,
            cwd=Path(__file__).parents[2],
            env=os.environ | {"PYTHONHASHSEED": seed},
        )
        assert done.returncode == 0, done.stderr
        stamps.append(json.loads(done.stdout))
    assert stamps[0] == stamps[1]
    assert len(stamps[0]) > 30


def test_steps_of_effects_are_told_apart() -> None:
    # two effects may share a law, and then its step
    steps = {id(cls.step): cls.step.key for cls in (*NAMED, *NOISES, *BENCH_ONLY) if cls.step is not None}
    assert len(set(steps.values())) == len(steps) > 30


IMPORTED_LIGHTLY = {
    "sim_backend.effects": {"numba", "llvmlite", "pandas", "matplotlib"},
    "sim_backend.simbench": {"numba", "llvmlite", "pandas", "matplotlib"},
    "campaigns.plans": {"numba", "llvmlite", "pandas", "matplotlib"},
    "analysis.identification.identify": {"numba", "llvmlite", "pandas", "matplotlib"},
    "analysis.diagnosis.api": {"numba", "llvmlite", "pandas", "matplotlib"},
}
"""Modules that are imported before anything is computed, and what they must leave for later.

scipy alone is light: its parts are imported with their first use (`scipy.stats.chi2`), and `scipy.signal`,
`scipy.stats` and `scipy.optimize` are what takes the time.
"""
PARTS_OF_SCIPY = {f"scipy.{part}" for part in ("signal", "stats", "optimize", "linalg", "fft", "interpolate", "sparse")}


@pytest.mark.parametrize("name", IMPORTED_LIGHTLY)
def test_an_import_brings_nothing_that_only_computing_needs(name: str) -> None:
    script = f"import json, sys; import {name}; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120)
    loaded = set(json.loads(done.stdout))
    assert loaded & (IMPORTED_LIGHTLY[name] | PARTS_OF_SCIPY) == set()
