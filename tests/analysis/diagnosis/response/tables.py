"""Tables of frequency response as another program would make them, and the model they are held against."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sim_backend.linear import ModalModel
from sim_backend.model import Model, Port, from_linear

F = np.geomspace(2.0, 500.0, 120)
MODES = ((31.0, 0.02, 40.0), (140.0, 0.01, 300.0))
"""Frequency in Hz, damping ratio and residue."""


def response(f: np.ndarray = F, softer: float = 1.0) -> np.ndarray:
    """The response of the two modes by their transfer function; `softer` scales the first one's frequency."""
    s = 2j * np.pi * f
    out = np.zeros(f.size, dtype=complex)
    for (hz, zeta, residue), scale in zip(MODES, (softer, 1.0), strict=True):
        omega = 2.0 * np.pi * hz * scale
        out += residue / (s**2 + 2.0 * zeta * omega * s + omega**2)
    return out


def noisy(h: np.ndarray, seed: int, relative: float = 2e-3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return h * (1.0 + relative * (rng.standard_normal(h.size) + 1j * rng.standard_normal(h.size)))


def written(path: Path, f: np.ndarray, h: np.ndarray, **more: np.ndarray) -> Path:
    heads = ["frequency (Hz)", "magnitude (rad/N m)", "phase (deg)", *more]
    columns = [f, np.abs(h), np.degrees(np.angle(h)), *more.values()]
    np.savetxt(path, np.stack(columns, axis=1), delimiter=",", header=",".join(heads), comments="")
    return path


def nominal(off: float = 0.02, seed: int = 0) -> Model:
    """The same modes, each number wrong by the part `off` (1 sigma)."""
    rng = np.random.default_rng(seed)
    hz, zeta, residue = (np.array(column) * (1.0 + off * rng.standard_normal(2)) for column in zip(*MODES, strict=True))
    omega = 2.0 * np.pi * hz
    none = np.zeros((2, 1))
    linear = ModalModel(
        omega, zeta * omega, residue[:, None], none, np.ones((1, 2)), none.T, np.zeros((1, 1)), np.zeros(1)
    )
    return modelled(linear, "two modes", ("",))


def modelled(linear: ModalModel, name: str, axes: tuple[str, ...]) -> Model:
    """A model of the drives u and readings y of axes x, each with the suffix of its axis."""
    inputs, outputs = (
        [Port(name=f"{letter}{axis}", unit=unit, dof=f"x{axis}") for axis in axes]
        for letter, unit in (("u", "N m"), ("y", "rad"))
    )
    return from_linear(
        linear,
        name=name,
        title="",
        sample_rate_hz=5000.0,
        inputs=inputs,
        outputs=outputs,
        origin="stated",
        source="",
    )
