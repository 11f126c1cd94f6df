"""Records with a fault of their own, or that a wrong reading of them would turn into one: what is said of each kind.

Samples lost, a period that is none, a late input, a slow sensor, an input that is held, runs that begin at rest.
Numbers, seeds and limits were fixed before any of these records had been diagnosed.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backend.model import Quantity, dump_model, load_model, number, with_std
from tests.end_to_end.linear_bench import multisine, oscillator, played
from tests.end_to_end.unknown_bench import diagnosis, identified, imported, mccd, write_data, write_map

Array = NDArray[np.float64]

RATE_HZ = 400.0
FREQUENCY_HZ, DAMPING_RATIO, GAIN = 9.0, 0.06, 2e-3
NEAR = 0.2
"""How near a noise must come to what was added: of a few hundred samples its rms is known to about 4 %."""


def moved(u: Array) -> Array:
    """Return the position (n,) of one mode under a held drive (n,), from rest."""
    drive = np.array([[0.0], [GAIN * (2.0 * np.pi * FREQUENCY_HZ) ** 2]])
    return played(oscillator(FREQUENCY_HZ, DAMPING_RATIO), drive, np.eye(1, 2), u[:, None], RATE_HZ)[:, 0]


def levels(rng: np.random.Generator, n: int) -> Array:
    """Return levels of random size (n,), eight samples each: nothing repeats."""
    return np.repeat(rng.standard_normal(n // 8), 8)


def noisy(rng: np.random.Generator, y: Array, part: float = 3e-4) -> Array:
    """Return readings (n,) with white noise of a part of their own size."""
    return y + part * y.std() * rng.standard_normal(y.size)


def periods(rng: np.random.Generator, *, period: int = 320, count: int = 6) -> Array:
    """Return equal periods of a multisine, (period * count,), with frequencies up to a sixth of the rate."""
    return np.tile(multisine(rng, period, slice(1, period // 6)), count)


def fitted(folder: Path, *options: str) -> dict[str, Any]:
    """Fit nominal.toml with one mode to run.h5, and return what the command says of the fit."""
    done = mccd(folder, "identify", "--log", "run.h5", "--modes", "1", *options, "-o", "nominal.toml", "--json")
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout)["identification"])


def in_parts(folder: Path, u: Array, y: Array) -> None:
    """Import a record (n,) that does not repeat, its last fifth held out."""
    write_data(folder, u, y)
    split = 4 * u.size // 5
    write_map(folder, RATE_HZ, [("levels", split), ("held-out levels", u.size - split)])
    imported(folder)


def test_a_record_with_lost_samples_is_not_consistent(tmp_path):
    rng = np.random.default_rng(610)
    u = levels(rng, 1600)
    y = noisy(rng, moved(u))
    kept = np.setdiff1d(np.arange(u.size), rng.choice(u.size, 16, replace=False))
    in_parts(tmp_path, u[kept], y[kept])
    identified(tmp_path, "--modes", "1")
    found = diagnosis(tmp_path)
    assert found["verdict"] != "consistent"
    assert found["exit_code"] == 1


def periodic_record(folder: Path, seed: int, period: int, told: int) -> None:
    """Write six periods and a map that says how long they are."""
    rng = np.random.default_rng(seed)
    u = periods(rng, period=period)
    write_data(folder, u, noisy(rng, moved(u)))
    write_map(folder, RATE_HZ, [("record", u.size)], period=told)


def test_a_period_that_is_none_is_refused_with_the_right_one(tmp_path):
    periodic_record(tmp_path, 611, period=320, told=319)
    done = mccd(tmp_path, "import", "map.toml", "-o", "run.h5")
    assert done.returncode == 4
    assert "period = 320" in done.stderr
    assert not (tmp_path / "run.h5").exists()


def test_a_model_from_another_run_with_a_wrong_frequency_gives_no_name(tmp_path):
    """Half a per cent off, a hundred times its stated error: nothing is missing that could be named."""
    periodic_record(tmp_path, 612, period=320, told=320)
    imported(tmp_path)
    fitted(tmp_path)
    model = load_model(tmp_path / "nominal.toml")
    (mode,) = model.modes
    value = number(mode.frequency_hz)
    other = Quantity(value=1.005 * value, origin="fitted", source="fit to another run", std=5e-5 * value)
    wrong = [msgspec.structs.replace(mode, frequency_hz=other)]
    (tmp_path / "nominal.toml").write_text(dump_model(msgspec.structs.replace(model, modes=wrong)), encoding="utf-8")
    found = diagnosis(tmp_path)
    assert found["causes"] == []
    assert not {"delay", "constant-torque"} & {name for tied in found["ambiguous"] for name in tied}


def test_both_commands_agree_on_held_out_samples_behind_a_delay(tmp_path):
    rng = np.random.default_rng(613)
    u = levels(rng, 1600)
    late = 5
    clean = moved(np.concatenate([np.zeros(late), u[:-late]]))
    y = noisy(rng, clean)
    in_parts(tmp_path, u, y)
    fit = fitted(tmp_path)
    held = slice(4 * u.size // 5, None)
    noise = np.std((y - clean)[held]) / np.std(y[held])
    found = diagnosis(tmp_path)
    assert found["verdict"] == "consistent"
    (own,) = fit["held_out"]
    assert own["total"] == pytest.approx(noise, rel=NEAR)
    assert found["gain"]["rms_before"] == pytest.approx(noise, rel=NEAR)


def test_a_sensor_that_reads_every_fifth_sample_makes_no_resonance(tmp_path):
    rng = np.random.default_rng(614)
    u = levels(rng, 1600)
    y = np.repeat(noisy(rng, moved(u))[::5], 5)
    in_parts(tmp_path, u, y)
    identified(tmp_path, "--modes", "1")
    found = diagnosis(tmp_path)
    assert found["verdict"] in ("unknown", "named", "ambiguous")
    assert {c["effect"] for c in found["causes"]} <= {"dropped-samples"}
    assert any("every 5th sample" in note for note in found["notes"])


def test_a_drive_that_is_held_is_not_taken_for_a_smooth_and_late_one(tmp_path):
    periodic_record(tmp_path, 615, period=400, told=400)
    imported(tmp_path)
    fit = fitted(tmp_path)
    assert fit["method"] == "periodic, zero-order hold"
    frequency_hz, std_hz = with_std(load_model(tmp_path / "nominal.toml").modes[0].frequency_hz)
    assert std_hz is not None
    assert abs(frequency_hz - FREQUENCY_HZ) < 4.0 * std_hz
    assert diagnosis(tmp_path)["verdict"] == "consistent"


STIFFENING_HZ, DECAY_1_S, INERTIA, CUBIC, SENSOR_RAD = 14.0, 1.3, 5e-5, 5.0, 3e-5
STIFF_RATE_HZ, STIFF_PERIOD = 600.0, 600
FRICTION_NM, STUCK_RAD_S = 5e-5, 2e-3


def light_mode(torque_nm: Array, cubic: float, friction_nm: float) -> Array:
    """Return the angle (n,) of a light mode with a cubic spring and friction under a held torque (n,), from rest.

    Runge and Kutta's fourth-order steps, sixteen to a sample: a mode turns by 0.01 in each, and errs by 1e-10 of that.
    """
    steps, omega = 16, 2.0 * np.pi * STIFFENING_HZ
    dt = 1.0 / (steps * STIFF_RATE_HZ)

    def slope(x: float, v: float, torque: float) -> tuple[float, float]:
        rubbed = friction_nm * np.tanh(v / STUCK_RAD_S)
        return v, (torque - cubic * x**3 - rubbed) / INERTIA - omega**2 * x - 2.0 * DECAY_1_S * v

    x, v, out = 0.0, 0.0, np.empty(torque_nm.size)
    for k, torque in enumerate(torque_nm.tolist()):
        out[k] = x
        for _ in range(steps):
            a1, b1 = slope(x, v, torque)
            a2, b2 = slope(x + dt / 2 * a1, v + dt / 2 * b1, torque)
            a3, b3 = slope(x + dt / 2 * a2, v + dt / 2 * b2, torque)
            a4, b4 = slope(x + dt * a3, v + dt * b3, torque)
            x += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            v += dt / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
    return out


HIGHEST = STIFF_PERIOD // 5
"""Line of a period above which nothing is played; the lowest is the second."""


def run_from_rest(
    folder: Path, rng: np.random.Generator, label: str, rms_nm: float, cubic: float = 0.0, friction_nm: float = 0.0
) -> Array:
    """Import four periods from rest as run.h5; return the angle (n,) without noise of these and of eight more."""
    wave = rms_nm * multisine(rng, STIFF_PERIOD, slice(2, HIGHEST))
    angle = light_mode(np.tile(wave, 12), cubic, friction_nm)
    u, y = np.tile(wave, 4), angle[: 4 * STIFF_PERIOD]
    folder.mkdir()
    write_data(folder, u, y + SENSOR_RAD * rng.standard_normal(y.size))
    write_map(folder, STIFF_RATE_HZ, [(label, u.size)], period=STIFF_PERIOD, unit="N m")
    (folder / "map.toml").write_text((folder / "map.toml").read_text().replace('unit = "m"', 'unit = "rad"'))
    imported(folder)
    return angle


def test_the_swing_from_rest_is_no_noise_of_a_linear_plant(tmp_path):
    """The noise is that of one period at all frequencies, as a part of what the bench answers."""
    angle = run_from_rest(tmp_path / "run", np.random.default_rng(616), "run", 3e-3)
    settled = angle[-STIFF_PERIOD:]  # nothing of the start is left after eleven seconds: exp(-14)
    noise = SENSOR_RAD / settled.std()
    assert fitted(tmp_path / "run")["noise"] == pytest.approx(noise, rel=NEAR)


@pytest.mark.parametrize(
    ("seed", "effect", "parameter", "law", "most_std"),
    [
        (617, "cubic-stiffness", "stiffness", {"cubic": CUBIC}, 1e-3),
        (618, "coulomb-friction", "torque", {"friction_nm": FRICTION_NM}, 1e-3 * FRICTION_NM),
    ],
)
def test_a_run_that_is_held_out_as_a_whole_is_simulated_from_rest(
    tmp_path: Path, seed: int, effect: str, parameter: str, law: dict[str, float], most_std: float
) -> None:
    rng = np.random.default_rng(seed)
    run_from_rest(tmp_path / "fit", rng, "fit", 8e-3, **law)
    run_from_rest(tmp_path / "small", rng, "small", 2.5e-3, **law)
    checked = run_from_rest(tmp_path / "check", rng, "held-out", 5e-3, **law)[: 4 * STIFF_PERIOD]
    noise = SENSOR_RAD / checked.std()
    fitted(tmp_path / "small")
    runs = [f"{name}/run.h5" for name in ("fit", "small", "check")]
    done = mccd(tmp_path, "diagnose", *runs, "--model", "small/nominal.toml", "-o", "out", "--json", "--no-page")
    assert done.returncode == 1, done.stderr
    found = json.loads(done.stdout)
    assert found["verdict"] == "named"
    (cause,) = found["causes"]
    assert cause["effect"] == effect
    size = cause["parameters"][parameter]
    (true,) = law.values()
    assert abs(size["value"] - true) < 4.0 * size["std"]
    assert size["std"] < most_std
    assert found["gain"]["noise_floor"] == pytest.approx(noise, rel=NEAR)
    assert found["gain"]["rms_after"] == pytest.approx(noise, rel=NEAR)
