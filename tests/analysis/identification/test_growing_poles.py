"""A plant that is unstable, measured in a loop that holds it, is never given a stable model without a word."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from analysis.identification.from_table import identify_table
from analysis.identification.identified import Identification
from analysis.identification.identify import identify_runs
from campaigns.importing import import_run
from campaigns.log import LogWriter, read_run
from sim_backend.bench import Signal
from tests.analysis.identification.test_closed_loop import MAP, NOISES, RATE_HZ, ROWS, played
from tests.analysis.identification.test_from_table import F, response, written

Array = NDArray[np.float64]

PLANTS = {
    "pendulum": np.array([[0.0, 1.0], [(2.0 * np.pi * 2.0) ** 2, -1.0]]),
    "flutter": np.array([[0.0, 1.0], [-((2.0 * np.pi * 10.0) ** 2), 2.0 * 0.05 * 2.0 * np.pi * 10.0]]),
}
"""A real pole that grows by 12.1 s⁻¹, and a pair at 10 Hz that grows by 3.14 s⁻¹."""


def growth(plant: str) -> float:
    return float(np.max(np.linalg.eigvals(PLANTS[plant]).real))


def held(plant: str, noise: str, seed: int) -> Array:
    """Return reference, drive and reading (n, 3) of an unstable plant under proportional and derivative action."""
    rng = np.random.default_rng(seed)
    model = (PLANTS[plant], np.array([[0.0], [100.0]]), np.eye(2), np.zeros((2, 1)))
    over, into, *_ = scipy.signal.cont2discrete(model, 1.0 / RATE_HZ)
    size, colour = NOISES[noise]
    reference = 0.05 * scipy.signal.lfilter([0.05], [1.0, -0.95], rng.standard_normal(ROWS))
    misread = size * scipy.signal.lfilter([1.0], colour, rng.standard_normal(ROWS))
    x, slope, last, out = np.zeros(2), 0.0, 0.0, np.empty((ROWS, 3))
    for k in range(ROWS):
        reading = x[0] + misread[k]
        error = reference[k] - reading
        slope, last = 0.8 * slope + 0.2 * RATE_HZ * (error - last), error
        drive = 100.0 * error + 1.2 * slope
        out[k] = reference[k], drive, reading
        x = over @ x + into[:, 0] * drive
    return out


def identified(folder: Path, data: Array) -> Identification:
    np.savetxt(folder / "data.csv", data, delimiter=",", header="r,u,y", comments="")
    (folder / "map.toml").write_text(MAP.format(period=""))
    import_run(folder / "map.toml", folder / "run.h5")
    with read_run(folder / "run.h5") as run:
        return identify_runs([run], modes=1)


def growing(found: Identification) -> list[str]:
    return [remark for remark in found.remarks if remark.startswith("the plant is unstable")]


def value_of(remark: str) -> float:
    return float(remark.partition("grows by ")[2].partition(" ")[0])


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("noise", ["white", "humming"])
def test_in_a_loop_by_its_reference(tmp_path, plant, noise):
    """The value is that of some ten averages; a quarter off still says how fast the plant runs away."""
    (told,) = growing(identified(tmp_path, held(plant, noise, 5)))
    assert value_of(told) == pytest.approx(growth(plant), rel=0.25)
    assert "do not use it" in told


@pytest.mark.parametrize("noise", NOISES)
def test_a_stable_plant_in_a_loop_is_not_called_unstable(tmp_path, noise):
    assert growing(identified(tmp_path, played(noise, 1, ROWS))) == []


@pytest.mark.parametrize("plant", PLANTS)
def test_in_a_table(tmp_path, plant):
    a, into = PLANTS[plant], np.array([0.0, 100.0])
    h = np.array([np.linalg.solve(2j * np.pi * f * np.eye(2) - a, into)[0] for f in F.tolist()])
    rng = np.random.default_rng(1)
    h = h * (1.0 + 1e-3 * (rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size)))
    (told,) = growing(identify_table(written(tmp_path / "h.csv", ["f (Hz)", "Re", "Im"], [F, h.real, h.imag]), modes=1))
    assert value_of(told) == pytest.approx(growth(plant), rel=0.05)


@pytest.mark.parametrize("modes", [1, 2, 4])
@pytest.mark.parametrize("late_s", [0.0, 3e-4])
def test_a_stable_table_is_not_called_unstable(tmp_path, modes, late_s):
    """Too few modes and a delay are misfits as well, and no growth."""
    rng = np.random.default_rng(2)
    h = response(F) * np.exp(-2j * np.pi * F * late_s)
    h = h * (1.0 + 1e-2 * (rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size)))
    path = written(tmp_path / "h.csv", ["f (Hz)", "Re", "Im"], [F, h.real, h.imag])
    assert growing(identify_table(path, modes=modes)) == []


@pytest.mark.parametrize(("kind", "reference", "told"), [("file", False, 0), ("file", True, 1), ("imported", False, 1)])
def test_what_a_bench_sweeps_without_a_loop_is_not_called_unstable(tmp_path, kind, reference, told):
    """A sweep from elsewhere may be of a loop that it does not tell of; one of our own says that it was none."""
    rng, rate, n = np.random.default_rng(3), 2000.0, 1000
    ports = [
        ("torque_x", "N m", "input"),
        ("x", "rad", "output"),
        *([("goal", "rad", "reference")] if reference else []),
    ]
    channels = [Signal(name, unit, role, "x", rate) for name, unit, role in ports]  # type: ignore[arg-type]
    t = np.arange(n) / rate
    with LogWriter.create(
        tmp_path / "run.h5", channels, test="sinesweep", bench={"kind": kind, "name": "other"}
    ) as log:
        for f in np.arange(2.0, 82.0, 2.0).tolist():  # whole periods
            g = np.linalg.solve(2j * np.pi * f * np.eye(2) - PLANTS["flutter"], [0.0, 100.0])[0]
            x = np.abs(g) * np.cos(2.0 * np.pi * f * t + np.angle(g)) + 1e-4 * np.abs(g) * rng.standard_normal(n)
            rows = {"torque_x": np.cos(2.0 * np.pi * f * t), "x": x} | ({"goal": x} if reference else {})
            with log.segment(f"{f:g} Hz", {"axis": "x", "frequency_hz": f, "measure_from": 0}):
                log.append(rows)
    with read_run(tmp_path / "run.h5") as run:
        assert len(growing(identify_runs([run], modes=1))) == told
