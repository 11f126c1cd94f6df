"""The motion that an input works against: its own output, what the file states, or the static inverse."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from sim_backend.assembly import coordinates_of
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel
from sim_backend.model import Model, Port, from_linear, parse_model
from sim_backend.model import dump_model as dumped

GAIN = np.array([[2.0, 1.0], [-1.0, 3.0]])


def crossed(omega: float = 50.0) -> Model:
    """Two drives and two sensors that do not stand beside each other, with the static gain GAIN."""
    linear = ModalModel(
        omega_rad_s=np.full(2, omega),
        sigma_1_s=np.ones(2),
        b=np.eye(2) * 2500.0,
        b_direct=np.zeros((2, 2)),
        c=GAIN,
        c_rate=np.zeros((2, 2)),
        d=np.zeros((2, 2)),
        delay_s=np.zeros(2),
    )
    ports = [Port(name=f"drive_{i}", unit="V", dof=f"piezo_{i}") for i in "ab"]
    seen = [Port(name=f"gap_{i}", unit="m", dof=f"point_{i}") for i in "ab"]
    return from_linear(
        linear, name="crossed", title="", sample_rate_hz=1e3, inputs=ports, outputs=seen, origin="stated", source=""
    )


def test_a_lone_input_works_against_the_direction_that_it_moves_alone() -> None:
    rows = coordinates_of(crossed())
    assert np.linalg.norm(rows, axis=1) == pytest.approx(1.0)
    along = rows @ GAIN
    assert along[0, 1] == pytest.approx(0.0, abs=1e-12)
    assert along[1, 0] == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.diag(along) > 0.0)


def test_a_rigid_body_has_no_static_direction_and_falls_back_on_the_rank() -> None:
    assert np.array_equal(coordinates_of(crossed(omega=0.0)), np.eye(2))


def test_what_the_file_states_comes_first_and_survives_the_file() -> None:
    stated = msgspec.structs.replace(crossed(), coordinates={"piezo_a": {"gap_b": 0.5}})
    again = parse_model(dumped(stated), "test")
    assert np.array_equal(coordinates_of(again)[0], [0.0, 0.5])
    assert np.array_equal(coordinates_of(again)[1], coordinates_of(crossed())[1])


def test_an_input_with_an_output_of_its_own_sees_that() -> None:
    own = msgspec.structs.replace(crossed(), outputs=[Port(name=f"gap_{i}", unit="m", dof=f"piezo_{i}") for i in "ba"])
    own = msgspec.structs.replace(own, modes=[msgspec.structs.replace(m, output={}) for m in own.modes])
    assert np.array_equal(coordinates_of(own), [[0.0, 1.0], [1.0, 0.0]])


def test_coordinates_of_ports_that_do_not_exist_are_refused() -> None:
    wrong = msgspec.structs.replace(crossed(), coordinates={"piezo_z": {"gap_b": 0.5}})
    with pytest.raises(ConfigError, match="piezo_z"):
        parse_model(dumped(wrong), "test")
