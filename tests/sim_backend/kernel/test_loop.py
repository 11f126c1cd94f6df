"""A loop with its effects inlined is the loop that calls them, to the last bit; its code is made once and kept."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import current_thread, main_thread

import msgspec
import numpy as np
import pytest

from sim_backend import kernel, kernel_cache, layout
from sim_backend.assembly import places_of
from sim_backend.bench import Gate, Learning, Segment
from sim_backend.control.blocks import filter_from_zpk
from sim_backend.control.feedback import theta_controller, z_controller
from sim_backend.effects import BENCH_ONLY, NAMED, NOISES
from sim_backend.kernel import machine
from sim_backend.kernel_cache import VARIABLE
from sim_backend.machine_code import compiled
from sim_backend.model import EffectEntry, load_model
from sim_backend.replay import replay
from sim_backend.simbench import SimBench
from tests.sim_backend.test_kernel import RATE_HZ, held_torque, one_axis, play

STEPPED = [cls for cls in (*NAMED, *NOISES, *BENCH_ONLY) if cls.step is not None]
SIZES = {"jiles-atherton": 0.01, "hysteresis": 1e-4, "magnetic-polynomial": 1e-3, "thermal-stiffness-drift": 1e-3}
N = 3000
ROOT = Path(__file__).parents[3]


@pytest.fixture
def asked(monkeypatch):
    """The structures of which a loop was asked for to play it, in order."""
    found = []
    loop_of = machine.loop_of

    def asking(structure):
        if current_thread() is main_thread():  # another one makes a loop aside
            found.append(structure)
        return loop_of(structure)

    monkeypatch.setattr(machine, "loop_of", asking)
    return found


def both(monkeypatch, asked, record):
    """Return what `record` returns with effects called and with effects inlined."""
    results = []
    for inlined in (False, True):
        monkeypatch.setattr(kernel.Loop, "_structure", lambda self, n, kind=int(inlined): self.structures[kind])
        asked.clear()
        results.append(record())
        assert asked and all(structure.inlined is inlined for structure in asked)
    return results


def closed():
    """A noisy, learning bench as built, whose loops close one after the other within a period."""
    x, z = theta_controller(RATE_HZ), z_controller(RATE_HZ)
    learning = Learning(filter_from_zpk([0.2], [0.5], 0.3, RATE_HZ), 0.1, 3, 500, (0.25, 0.5, 0.25))
    reference = np.zeros((500, 3))
    reference[100:300, :2] = [4e-3, -2e-3]
    gates = (Gate(0, 0, True), Gate(50, 1, True, integrator=1e-3), Gate(50, 2, True), Gate(450, 1, False))
    feedforward = 0.01 * np.random.default_rng(2).standard_normal((500, 3))
    return Segment("closed", N, reference, feedforward, (x, x, z), gates, (learning, None, None))


@pytest.mark.parametrize("substeps", (1, 3))
def test_inlined_effects_give_the_same_bits_on_the_bench_as_built(monkeypatch, asked, substeps):
    def record():
        bench = SimBench(load_model("as-built"), 3, substeps=substeps, truth=True)
        # the second run goes on from the states that the first one left
        return [bench.play(closed()).channels for _ in range(2)]

    called, inlined = both(monkeypatch, asked, record)
    for before, after in zip(called, inlined, strict=True):
        for name, values in before.items():
            np.testing.assert_array_equal(after[name], values, err_msg=name)
    assert np.ptp(called[0]["theta_x"]) > 1e-3


def test_inlined_effects_give_the_same_bits_for_every_effect(monkeypatch, asked):
    model = load_model("as-built")
    entries = []
    for cls in STEPPED:
        size = SIZES.get(cls.name, 1e-6)
        sizes = dict.fromkeys(cls.sizes(), size)
        source = "theta_y->" if cls.aux.name.startswith("SOURCE") else ""
        shapes = {p.name: 0.05 for p in cls.parameters() if not p.size and not (np.isfinite(p.neutral) and p.neutral)}
        entries.append(EffectEntry(effect=cls.name, where=f"{source}theta_x", parameters={**sizes, **shapes}))

    def record():
        bench = SimBench(msgspec.structs.replace(model, effects=entries), 3, truth=True)
        torque = np.stack([held_torque(N, seed) for seed in (1, 2, 3)], axis=1)
        return bench.play(Segment("open", N, np.zeros_like(torque), torque)).channels

    called, inlined = both(monkeypatch, asked, record)
    assert len(asked[-1].steps) == len(STEPPED)
    for name, values in called.items():
        np.testing.assert_array_equal(inlined[name], values, err_msg=name)


def empty(monkeypatch, folder):
    """Let the kernel cache be an empty folder, no loop be in this process, and none be made aside for long play."""
    monkeypatch.setenv(VARIABLE, str(folder))
    monkeypatch.setattr(kernel, "LONG", np.inf)
    for name, nothing in (("_loaded", {}), ("_locks", {}), ("_absent", set())):
        monkeypatch.setattr(machine, name, nothing)


def test_a_bench_that_is_played_for_long_gets_a_loop_of_its_own(monkeypatch, asked, tmp_path):
    empty(monkeypatch, tmp_path)
    monkeypatch.setattr(kernel, "LONG", 2500)
    kernel.played.clear()
    torque = held_torque(1000)[:, None]
    segment = Segment("again", 1000, np.zeros_like(torque), torque)
    model = one_axis((("cubic-stiffness", {"stiffness": 1e3}),))
    benches = SimBench(model, 0), SimBench(model, 0)
    runs = [benches[0].play(segment) for _ in range(3)]
    assert [structure.inlined for structure in asked[:3]] == [False, False, False]
    # the third run went beyond LONG, so the other loop is being made aside now
    machine.wait()
    asked.clear()
    runs.append(benches[0].play(segment))
    assert [structure.inlined for structure in asked] == [True]
    # a process that comes later has it from disk from the first sample on, and all of them play the same
    monkeypatch.setattr(machine, "_loaded", {})
    asked.clear()
    for run in runs:
        np.testing.assert_array_equal(benches[1].play(segment).channels["theta_x"], run.channels["theta_x"])
    assert [structure.inlined for structure in asked] == [True] * 4


def test_benches_that_differ_in_numbers_alone_share_a_loop(asked):
    play(one_axis(frequency_hz=20.0), held_torque(200))
    play(one_axis(frequency_hz=30.0), held_torque(200))
    assert asked[0] == asked[1]
    play(one_axis(delay_s=1e-4), held_torque(200))
    assert asked[2] != asked[1]


def test_a_torque_fed_through_is_in_the_reading_of_its_own_sample():
    model, u = load_model("design"), np.random.default_rng(4).standard_normal((300, 3))
    eye, direct = np.eye(3), np.array([[0.3, 0.0, 0.1], [0.0, -0.2, 0.0], [0.0, 0.0, 0.4]])
    own = layout.Transducers(eye, eye, eye, eye, np.array([293.15, 0.0, 1.0, 1.0, 0.0]))
    with_it, without = (
        replay(model.linear().with_(d=d), (), places_of(model), own, u, RATE_HZ).reading for d in (direct, 0.0 * eye)
    )
    # sums of less than ten terms below 1
    np.testing.assert_allclose(with_it, without + u @ direct.T, rtol=0, atol=1e-14)


def test_code_is_read_from_disk(monkeypatch, tmp_path):
    empty(monkeypatch, tmp_path / "new")
    first = play(one_axis(), held_torque(200))["theta_x"]
    empty(monkeypatch, tmp_path / "new")
    monkeypatch.setattr(machine, "compiled", None)
    np.testing.assert_array_equal(play(one_axis(), held_torque(200))["theta_x"], first)
    assert len(list((tmp_path / "new").glob("loop-*"))) == 1


def test_a_process_that_compiles_nothing_plays_what_another_has_kept(tmp_path):
    script = (
        "import sys\n"
        "from tests.sim_backend.test_kernel import held_torque, one_axis, play\n"
        "from sim_backend import kernel\n"
        "from sim_backend.kernel import machine\n"
        "kernel.Loop._is_inlined = lambda self, n: True\n"
        "machine.compiled = None if sys.argv[1] == 'kept' else machine.compiled\n"
        "print(play(one_axis(), held_torque(200))['theta_x'].tobytes().hex())"
    )
    environment = os.environ | {VARIABLE: str(tmp_path)}
    printed = [
        subprocess.run([sys.executable, "-c", script, how], env=environment, capture_output=True, check=True).stdout
        for how in ("made", "kept")
    ]
    assert printed[0] and printed[1] == printed[0]


def test_a_folder_that_cannot_be_written_only_costs_time(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    empty(monkeypatch, tmp_path / "file" / "folder")
    monkeypatch.setattr(kernel_cache, "_told", set())
    with pytest.warns(kernel_cache.KernelCacheWarning, match="no folder to keep compiled code in"):
        moved = play(one_axis(), held_torque(200))["theta_x"]
    assert np.any(moved)


@pytest.mark.parametrize("damage", ["cut short", "one bit", "of another loop"])
def test_damaged_code_is_made_again(monkeypatch, tmp_path, damage):
    empty(monkeypatch, tmp_path)
    right = play(one_axis(), held_torque(200))["theta_x"]
    (file,) = tmp_path.glob("loop-*")
    code = file.read_bytes()
    if damage == "of another loop":
        file.unlink()
        play(one_axis(delay_s=1e-4), held_torque(200))
        (other,) = tmp_path.glob("loop-*")
        other.rename(file)
    else:
        half = len(code) // 2
        file.write_bytes(
            code[:half] if damage == "cut short" else code[:half] + bytes([code[half] ^ 1]) + code[half + 1 :]
        )
    empty(monkeypatch, tmp_path)
    monkeypatch.setattr(kernel_cache, "_told", set())
    with pytest.warns(kernel_cache.KernelCacheWarning, match="is damaged"):
        np.testing.assert_array_equal(play(one_axis(), held_torque(200))["theta_x"], right)
    assert file.read_bytes() == code


def test_threads_that_need_the_same_loop_make_it_once(monkeypatch, tmp_path):
    made = []

    def making(*what, **how):
        made.append(what)
        return compiled(*what, **how)

    empty(monkeypatch, tmp_path)
    monkeypatch.setattr(machine, "compiled", making)
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda _: play(one_axis(), held_torque(2000))["theta_x"], range(8)))
    assert len(made) == 1
    for values in results[1:]:
        np.testing.assert_array_equal(values, results[0])


def printed_twice(script):
    """What two processes print, of which the second finds what the first has kept."""
    command = [sys.executable, "-c", script]
    return [subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout for _ in range(2)]


def test_a_process_that_only_loads_code_plays_it(monkeypatch, tmp_path):
    """Without numba, which prepares LLVM for this processor as a side effect."""
    empty(monkeypatch, tmp_path)
    script = (
        "import sys, numpy as np\n"
        "from sim_backend.simbench import SimBench\n"
        "from tests.sim_backend.test_kernel import held_torque, one_axis, play\n"
        "print(play(one_axis(), held_torque(200))['theta_x'].tobytes().hex())"
    )
    printed = printed_twice(script)
    assert printed[0] == printed[1] and len(printed[0]) == 2 * 8 * 200 + 1


def test_kept_code_needs_no_numba():
    """With noise and with gates, which are compiled beside the loop; the first process keeps what is not there yet."""
    script = (
        "import sys\n"
        "from benchmarks.speed.chopping import chopping\n"
        "from sim_backend.model import load_model\n"
        "from sim_backend.simbench import SimBench\n"
        "played = SimBench(load_model('as-built'), 1).play(chopping(500)).channels\n"
        "print(b''.join(played[name].tobytes() for name in sorted(played)).hex())\n"
        "print('numba' in sys.modules)"
    )
    printed = printed_twice(script)
    (first, _), (second, loading) = (text.split() for text in printed)
    assert first == second and len(first) > 2 * 8 * 500
    assert loading == "False"


def test_code_that_another_thread_plays_is_not_let_go(monkeypatch, tmp_path):
    """Between the keeping of a loop and its first use here, another thread may load it from disk and play it."""
    empty(monkeypatch, tmp_path)
    make, loaded = machine._made, []  # noqa: SLF001

    def made(structure):
        found = make(structure)
        assert machine.load(structure)  # as another thread does
        loaded.append((machine._loaded[structure], found))  # noqa: SLF001
        return found

    monkeypatch.setattr(machine, "_made", made)
    play(one_axis(), held_torque(200))
    ((theirs, ours),) = loaded
    assert theirs is not ours and machine._loaded == {structure: theirs for structure in machine._loaded}  # noqa: SLF001
