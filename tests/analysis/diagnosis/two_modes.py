"""An axis of two modes, as a linear model and as a model file has it, and a drive for it."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from sim_backend.linear import ModalModel
from sim_backend.model import Mode, Model, Port

RATE_HZ = 2000.0
INERTIA = 3.23e-4


def linear_model() -> ModalModel:
    return ModalModel(
        omega_rad_s=2 * np.pi * np.array([30.0, 250.0]),
        sigma_1_s=np.array([5.0, 20.0]),
        b=np.array([[1 / INERTIA], [-0.5 / INERTIA]]),
        b_direct=np.zeros((2, 1)),
        c=np.array([[1.0, 1.0]]),
        c_rate=np.array([[0.0, 1e-5]]),
        d=np.zeros((1, 1)),
        delay_s=np.zeros(1),
    )


def one_axis() -> Model:
    modes = [
        Mode(label="low", frequency_hz=30.0, decay_rate_1_s=5.0, input={"u": 1 / INERTIA}, output={"y": 1.0}),
        Mode(label="high", frequency_hz=250.0, decay_rate_1_s=20.0, input={"u": -0.5 / INERTIA}, output={"y": 1.0}),
    ]
    return Model(
        name="one axis",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name="u", unit="N m", dof="theta_x")],
        outputs=[Port(name="y", unit="rad", dof="theta_x")],
        modes=modes,
    )


def drive(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return 0.05 * lfilter([0.05], [1, -0.95], rng.standard_normal(n))[:, None]
