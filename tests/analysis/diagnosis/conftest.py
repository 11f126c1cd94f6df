"""Logs and models of a small oscillator, made for the tests of the diagnosis."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from campaigns.log import Channel, LogWriter
from sim_backend.model import Mode, Model, Port

Array = NDArray[np.float64]
RATE_HZ = 1000.0
BENCH = {"kind": "sim", "name": "oscillator"}


@pytest.fixture
def oscillator() -> Model:
    """One mode at 20 Hz from a force to a displacement of dof x; DC gain 1 m/N."""
    omega = 2.0 * np.pi * 20.0
    return Model(
        name="oscillator",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name="force", unit="N", dof="x")],
        outputs=[Port(name="x", unit="m", dof="x")],
        modes=[Mode(label="only", frequency_hz=20.0, decay_rate_1_s=6.0, input={"force": omega**2}, output={"x": 1.0})],
    )


WriteLog = Callable[..., Path]


@pytest.fixture
def write_log(tmp_path: Path) -> WriteLog:
    """Return a function that writes channels {name: (n,)} with segments [(label, start, stop, settings)] as a log."""

    def write(
        values: Mapping[str, Array],
        segments: Sequence[tuple[str, int, int, dict[str, Any]]],
        *,
        name: str = "run.h5",
        channels: Sequence[Channel] | None = None,
        bench: Mapping[str, str] = BENCH,
        configuration: Mapping[str, Any] | None = None,
        status: str = "complete",
        rate_hz: float = RATE_HZ,
        run_uid: str | None = None,
    ) -> Path:
        if channels is None:
            channels = [Channel("command_x", "N", "input", "x", rate_hz), Channel("x", "m", "output", "x", rate_hz)]
        path = tmp_path / name
        with LogWriter.create(
            path,
            channels,
            test="made for a test",
            bench=bench,
            configuration=json.dumps(configuration or {}),
            run_uid=run_uid,
        ) as log:
            done = 0
            for label, start, stop, settings in segments:
                log.append({k: v[done:start] for k, v in values.items()})
                with log.segment(label, settings):
                    log.append({k: v[start:stop] for k, v in values.items()})
                done = stop
            log.append({k: v[done:] for k, v in values.items()})
            log.set_status(status)
        return path

    return write


@pytest.fixture
def motion() -> dict[str, Array]:
    """4000 rows of noise as a command and a resonant answer to it, with a little noise."""
    rng = np.random.default_rng(1)
    u = rng.standard_normal(4000)
    return {"command_x": u, "x": lfilter([1e-3], [1.0, -1.95, 0.97], u) + 1e-5 * rng.standard_normal(4000)}
