"""The paper's nonlinear model (Fig. 6.8) as it is fitted to the recorded loops, played without noise."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec
import numpy as np

from analysis.recorded.hysteresis import BEFORE_S, OffsetStep, averaged_steps, axis_of
from analysis.recorded.loop_fit import HELD
from campaigns.log import Run
from campaigns.plans import make_plan
from sim_backend.model import EffectEntry, Model, load_model
from sim_backend.simbench import SimBench

SUSPENSION = "theta_x suspension"


def fitted_model(parameters: Mapping[str, float], base: str = "design-4th-order") -> Model:
    """Return the linear model `base` with the fitted hysteresis and polynomial in θx (see measurements/loop_fit.py).

    Its suspension becomes as stiff as the fit says without the hysteresis.
    """
    model = load_model(base)
    linear = model.linear()
    i = next(k for k, mode in enumerate(model.modes) if mode.label == SUSPENSION)
    compliance = linear.c[0] * linear.b[:, 0] / linear.omega_rad_s**2
    wanted = 1.0 / parameters["stiffness"] - (compliance.sum() - compliance[i])
    hz = math.sqrt(linear.c[0, i] * linear.b[i, 0] / wanted) / (2.0 * math.pi)
    modes = [msgspec.structs.replace(m, frequency_hz=hz) if k == i else m for k, m in enumerate(model.modes)]
    polynomial = {f"p{6 - power}": parameters[f"power_{power}"] for power in (5, 4, 3, 2)}
    effects = [
        EffectEntry(
            effect="jiles-atherton",
            where="theta_x",
            parameters={**HELD, "pinning": parameters["pinning"], "size": parameters["size"]},
        ),
        EffectEntry(effect="magnetic-polynomial", where="theta_x", parameters={**polynomial, "p5": 0.0, "p6": 0.0}),
    ]
    return msgspec.structs.replace(model, name="fitted", modes=modes, effects=effects)


def simulated_steps(run: Run, parameters: Mapping[str, float]) -> list[OffsetStep]:
    """Return the steps of a hysteresis test as the fitted model takes them, its loops before them included."""
    plan = make_plan("hysteresis", run.header.settings)
    model = fitted_model(parameters)
    bench, steps, rest = SimBench(model, 0), list[OffsetStep](), 0.0
    axis = axis_of(run)
    drive = [port.dof for port in model.inputs].index(axis)
    before = round(BEFORE_S * run.sample_rate_hz)
    for segment in plan.segments(bench):
        angle = bench.play(segment).channels[axis]
        if segment.settings.get("phase") == "step":
            time_s = np.arange(angle.size) / run.sample_rate_hz
            offset, step = (float(segment.settings[name]) for name in ("offset_rad", "step_rad"))
            steps.append(OffsetStep(offset, step, rest, time_s, angle - rest, segment.feedforward[:, drive]))
        rest = float(angle[-before:].mean())
    return averaged_steps(steps)
