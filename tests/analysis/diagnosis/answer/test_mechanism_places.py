"""Where the picture of a cause is drawn: only where what it shows is the force, and not the motion that it makes."""

from __future__ import annotations

import dataclasses

import msgspec

from analysis.diagnosis.answer.mechanism import mechanism_figure
from sim_backend.effects import make_effect
from sim_backend.model import Model, Port
from tests.analysis.diagnosis.answer.test_mechanism import SPRING, axis, diagnosed, drawn, white


def driven_by(*names: str) -> Model:
    """The axis, read where no input acts."""
    inputs = [Port(name=f"u{k}" if k else "u", unit="N m", dof=name) for k, name in enumerate(names)]
    return msgspec.structs.replace(axis(), inputs=inputs)


def test_the_only_input_has_its_force_whatever_the_output_is_called():
    found, *_ = diagnosed("cubic-stiffness")
    effect = make_effect("cubic-stiffness", "drive", {"stiffness": SPRING})
    cause = dataclasses.replace(found.causes[0], where="drive")
    one = dataclasses.replace(found, effects=(effect,), causes=(cause,))
    figure = mechanism_figure(one, driven_by("drive"), white())
    assert figure is not None
    assert drawn(figure.canvas, "measured")[3].startswith("torque that the linear model lacks")


def test_one_of_several_inputs_without_a_reading_of_its_own_has_no_picture():
    found, *_ = diagnosed("cubic-stiffness")
    effect = make_effect("cubic-stiffness", "drive", {"stiffness": SPRING})
    cause = dataclasses.replace(found.causes[0], where="drive")
    two = dataclasses.replace(found, effects=(effect,), causes=(cause,))
    assert mechanism_figure(two, driven_by("drive", "other"), white()) is None
