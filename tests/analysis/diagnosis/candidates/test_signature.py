"""What is looked for: first-order signatures against full simulations, and where they are tried."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.candidates.signature import Candidate, Motion, Scales, enumerate_candidates, signature
from analysis.diagnosis.nominal.responses import simulate
from sim_backend.assembly import places_of, transducers_of
from sim_backend.effects import EFFECTS, effect_class
from sim_backend.effects.view import RecordView
from sim_backend.linear import discretise
from sim_backend.replay import replay
from tests.analysis.diagnosis.two_modes import RATE_HZ, drive, one_axis


def test_signature_is_the_first_order_of_the_simulation() -> None:
    model, u = one_axis(), drive(2000)
    linear, places = model.linear(), places_of(model)
    position = simulate(discretise(linear, RATE_HZ), u)
    rate = np.gradient(position, 1.0 / RATE_HZ, axis=0)
    seen = Motion(u, position, position, rate, np.zeros_like(position), None)
    hidden = {"cubic-stiffness": {"stiffness": 20.0}, "coulomb-friction": {"torque": 1e-6, "breakaway_rate": 0.01}}
    for name, parameters in hidden.items():
        cls = effect_class(name)
        shapes = {k: v for k, v in parameters.items() if k in cls.shapes()}
        sizes = {k: v for k, v in parameters.items() if k in cls.sizes()}
        column = signature(
            Candidate(cls, "theta_x", shapes, sizes, shapes), linear, places, seen, RATE_HZ, np.zeros((2, 2))
        )[:, 0, 0]
        exact = replay(linear, [cls("theta_x", **parameters)], places, transducers_of(model), u, RATE_HZ, substeps=8)
        change = (exact.reading - position)[:, 0]
        # held over a sample, a motion-dependent torque acts half a sample late: pi f / rate = 5 % at 30 Hz
        assert np.linalg.norm(column - change) < 0.08 * np.linalg.norm(change), name


def test_every_effect_is_tried_at_every_place_it_can_act() -> None:
    model, u = one_axis(), drive(2000)
    position = simulate(discretise(model.linear(), RATE_HZ), u)
    rate = np.gradient(position, 1.0 / RATE_HZ, axis=0)
    view = RecordView(
        RATE_HZ, u[:, 0], position[:, 0], rate[:, 0], 1e-6 * position[:, 0], np.linspace(70, 80, 2000), 30.0
    )
    scales = Scales(np.array([0.05]), np.array([1e-3]), 5e-3, 10.0)
    tried = {c.effect.name for c in enumerate_candidates(EFFECTS, places_of(model), {"theta_x": view}, scales)}
    assert {"cubic-stiffness", "coulomb-friction", "delay", "thermal-stiffness-drift", "amplifier-saturation"} <= tried
    assert "cross-coupling" not in tried  # one axis has nothing to couple to
