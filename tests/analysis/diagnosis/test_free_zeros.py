"""A zero that identification fitted beside what a model lacks: free in the diagnosis, and corrected in its model."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from analysis.diagnosis.answer.output import extended_model
from analysis.diagnosis.api import diagnose
from analysis.diagnosis.result import Diagnosis
from sim_backend.model import Model, Quantity, number, parse_model
from tests.end_to_end.unknown_bench import Array

RATE_HZ, ROWS, FINER = 2000.0, 3000, 16
INERTIA, STIFFNESS, DAMPING, STIFFENING = 3.23e-4, 11.16, 3.0e-3, 2e4
NOISE_RAD = 2e-6
OFF = 1.5 * NOISE_RAD
"""What a fit has made of a zero that is none: less than a single reading shows, and many times what all of them do."""

MODEL = f"""
schema = "mccd-model/1"
name = "nominal"
sample_rate_hz = {RATE_HZ}
inputs = [{{ name = "torque", unit = "N m", dof = "theta" }}]
outputs = [{{ name = "theta", unit = "rad", dof = "theta" }}]
[[modes]]
label = "suspension"
frequency_hz = 29.3
decay_rate_1_s = 4.7
input.torque = 3110.0
output.theta = 1.0
[[effects]]
effect = "sensor-offset"
where = "theta"
[effects.parameters.offset]
value = {OFF}
origin = "ORIGIN"
source = "free fit to run record 0"
"""


def moved(torque_nm: Array) -> Array:
    """Return the angle (n,) of a mirror on a stiffening spring under held torques (n,): velocity Verlet."""
    dt, angle, rate, out = 1.0 / (FINER * RATE_HZ), 0.0, 0.0, np.empty_like(torque_nm)

    def acceleration(torque: float, x: float, v: float) -> float:
        return (torque - STIFFNESS * x - STIFFENING * x**3 - DAMPING * v) / INERTIA

    for k, torque in enumerate(torque_nm):
        out[k] = angle
        for _ in range(FINER):
            half = rate + 0.5 * dt * acceleration(torque, angle, rate)
            angle += dt * half
            rate = half + 0.5 * dt * acceleration(torque, angle, half)
    return out


@pytest.fixture(scope="module")
def record() -> tuple[Array, Array]:
    """Drive and reading (n,) whose zero is none."""
    rng = np.random.default_rng(3)
    torque = np.repeat(rng.uniform(-0.04, 0.04, ROWS // 200), 200) + 0.002 * rng.standard_normal(ROWS)
    return torque, moved(torque) + NOISE_RAD * rng.standard_normal(ROWS)


def diagnosed(record: tuple[Array, Array], origin: str) -> tuple[Model, Diagnosis]:
    model = parse_model(MODEL.replace("ORIGIN", origin), "nominal")
    return model, diagnose(*record, RATE_HZ, model)


def test_what_a_fit_to_these_runs_said_of_a_zero_is_found_anew(record: tuple[Array, Array]) -> None:
    model, found = diagnosed(record, "fitted")
    assert found.verdict == "named", found.sentence
    assert [(c.effect, c.where) for c in found.causes] == [("cubic-stiffness", "theta")]
    # with the zero left where it was, the error would be sqrt(1 + 1.5^2) = 1.8 times the noise
    assert found.gain is not None and found.gain.rms_after < 1.1 * found.gain.noise_floor
    (zero, *_) = extended_model(model, found, []).effects
    offset = zero.parameters["offset"]
    assert isinstance(offset, Quantity) and offset.origin == "fitted" and offset.std is not None
    assert abs(number(offset)) < 4.0 * offset.std < 0.5 * OFF


def test_a_zero_from_elsewhere_stays(record: tuple[Array, Array]) -> None:
    torque, reading = record
    model, found = diagnosed((torque, reading + OFF), "stated")
    assert [(c.effect, c.where) for c in found.causes] == [("cubic-stiffness", "theta")]
    assert msgspec.to_builtins(extended_model(model, found, []).effects[0]) == msgspec.to_builtins(model.effects[0])
