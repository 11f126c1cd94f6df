"""One axis in closed loop, with the iron of the bench: ours, python-control's nonlinear simulation, and solve_ivp.

The controller is sampled at 10 kHz and its torque held, so that solve_ivp integrates from sample to sample, and
python-control, which knows no mixture of the two times, steps the plant exactly over a sample as ours does.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import control
import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared, times_faster, version_of
from sim_backend.bench import Gate, Segment
from sim_backend.control.feedback import theta_controller
from sim_backend.effects import make_effect
from sim_backend.kernel import machine
from sim_backend.linear import discretise
from sim_backend.model import Model, load_model, number
from sim_backend.simbench import SimBench

Array = NDArray[np.float64]

OURS, CONTROL, IVP = "mccd SimBench", "control input_output_response", "scipy solve_ivp"
FUSED = "control input_output_response, one system by hand"
EXACT, FINER = "scipy solve_ivp, 1e-10", "scipy solve_ivp, DOP853, 1e-12"
SETTINGS: dict[str, dict[str, Any]] = {
    f"{method}, rtol {rtol:g}, atol {atol:g}{', first step given' if given else ''}": {
        **{"method": method, "rtol": rtol, "atol": atol},
        **({"first_step": 1e-4} if given else {}),
    }
    for method in ("RK23", "RK45")
    for rtol, atol in ((1e-2, 1e-6), (1e-3, 1e-9), (1e-5, 1e-11))
    for given in (True, False)
}
"""Ways to ask solve_ivp, of which the fastest that is as accurate as ours takes part; a sample takes 1e-4 s."""
EQUAL = 1e-4
"""Error relative to the move that all may have; what each has is told."""
PERIOD, STEP_RAD, MOVE = 2_000, 8.5e-3, 100
SAMPLES, QUICK = 600_000, PERIOD
"""Samples that ours plays, in full and quick; every peer plays the first whole period of the chop."""
QUICK_PEERS = PERIOD // 20
"""Samples of the peers in the quick run, which asks only whether all are the same."""
EFFECTS = ("jiles-atherton", "magnetic-polynomial", "constant-torque")


@cache
def model() -> Model:
    """Return θx of the bench as built: its modes and iron, ideal amplifier and sensor."""
    whole = load_model("as-built")
    return msgspec.structs.replace(
        whole,
        name="one-axis",
        inputs=whole.inputs[:1],
        outputs=whole.outputs[:1],
        modes=[m for m in whole.modes if "torque_x" in m.input],
        effects=[e for e in whole.effects if e.where == "theta_x" and e.effect in EFFECTS],
        hardware=None,
    )


def reference() -> Array:
    """Return one period: a smooth move (the minimum-jerk polynomial) there, a dwell, and the same back."""
    s = np.clip(np.arange(PERIOD // 2) / MOVE, 0.0, 1.0)
    there = STEP_RAD * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return np.concatenate([there, STEP_RAD - there])


def parameters() -> dict[str, list[float]]:
    """Return the parameters of the three effects, in the order of their fields."""
    found = {}
    for e in model().effects:
        found[e.effect] = list(make_effect(e.effect, e.where, {k: number(v) for k, v in e.parameters.items()}).values())
    return found


def ours(n: int) -> Array:
    """Return the readings (n,) of a fresh bench."""
    wave = reference()[:, None]
    loop = (theta_controller(),)
    segment = Segment("loop", n, wave, np.zeros_like(wave), loop, (Gate(0, 0, True),), record=("theta_x",))
    return SimBench(model(), 0).play(segment).channels["theta_x"]


def blocks_together(a: Array) -> Array:
    """Return blocks (m, 2, 2) as one block-diagonal matrix."""
    whole = np.zeros((2 * a.shape[0], 2 * a.shape[0]))
    for i, block in enumerate(a):
        whole[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = block
    return whole


def connected() -> control.NonlinearIOSystem:
    """Return the closed loop as python-control builds it: plant, controller and difference, connected.

    The plant's states: modes (q, v), the iron's field and magnetisation, the last torque of the iron, 1 after the first
    sample.
    """
    exact, loop, given = discretise(model().linear(), model().sample_rate_hz), theta_controller(), parameters()
    iron = make_effect("jiles-atherton", "theta_x", {}).step.__wrapped__
    a, b, c, end = blocks_together(exact.a), exact.b[:, :, 0].ravel(), exact.c[0].ravel(), 2 * exact.a.shape[0]

    def update(t: float, x: Array, u: Array, params: Any) -> Array:
        memory, position = x[end:].tolist(), float(c @ x[:end])
        pull = iron(0.0, position, 0.0, 0.0, 0.0, given["jiles-atherton"], memory)
        pull += np.polyval(given["magnetic-polynomial"], position) + given["constant-torque"][0]
        torque = u[0] + pull + 0.5 * (pull - memory[2]) * memory[3]
        return np.concatenate([a @ x[:end] + b * torque, [*memory[:2], pull, 1.0]])

    def output(t: float, x: Array, u: Array, params: Any) -> Array:
        return np.array([c @ x[:end]])

    dt_s = 1.0 / model().sample_rate_hz
    plant = control.nlsys(update, output, inputs=["torque"], outputs=["theta"], states=end + 4, dt=dt_s)
    gains = (blocks_together(loop.a), loop.b.reshape(-1, 1), loop.c.reshape(1, -1), loop.d)
    controller = control.ss(*gains, dt_s, inputs=["error"], outputs=["torque"])
    difference = control.summing_junction(["reference", "-theta"], "error")
    return control.interconnect([plant, controller, difference], inputs=["reference"], outputs=["theta"])


def fused() -> control.NonlinearIOSystem:
    """Return the same loop as one system written by hand, which spares python-control all connections."""
    exact, loop, given = discretise(model().linear(), model().sample_rate_hz), theta_controller(), parameters()
    iron = make_effect("jiles-atherton", "theta_x", {}).step.__wrapped__
    a, b, c, end = blocks_together(exact.a), exact.b[:, :, 0].ravel(), exact.c[0].ravel(), 2 * exact.a.shape[0]
    fa, fb, fc, last = blocks_together(loop.a), loop.b.ravel(), loop.c.ravel(), end + 2 * loop.n_blocks

    def update(t: float, x: Array, u: Array, params: Any) -> Array:
        memory, position = x[last:].tolist(), float(c @ x[:end])
        error = u[0] - position
        pull = iron(0.0, position, 0.0, 0.0, 0.0, given["jiles-atherton"], memory)
        pull += np.polyval(given["magnetic-polynomial"], position) + given["constant-torque"][0]
        torque = float(fc @ x[end:last]) + loop.d * error + pull + 0.5 * (pull - memory[2]) * memory[3]
        return np.concatenate([a @ x[:end] + b * torque, fa @ x[end:last] + fb * error, [*memory[:2], pull, 1.0]])

    def output(t: float, x: Array, u: Array, params: Any) -> Array:
        return np.array([c @ x[:end]])

    return control.nlsys(update, output, inputs=1, outputs=1, states=last + 4, dt=1.0 / model().sample_rate_hz)


def iron_slope(field: float, magnetisation: float, rising: bool, p: list[float]) -> float:
    """Return dM/dH of (6.4) of the paper with the anhysteretic curve (6.5); `p` as in `JilesAtherton`."""
    _, a, pinning, c, alpha, saturation = p
    x = (field + alpha * magnetisation) / a
    if abs(x) < 1e-2:
        man, dman = saturation * (x / 3.0 - x**3 / 45.0), saturation / a * (1.0 / 3.0 - x * x / 15.0)
    else:
        man = saturation * (1.0 / math.tanh(x) - 1.0 / x)
        dman = saturation / a * (1.0 - 1.0 / math.tanh(x) ** 2 + 1.0 / x**2)
    gap, sign = man - magnetisation, 1.0 if rising else -1.0
    pinned = gap / (sign * pinning - alpha * gap) if sign * gap > 0.0 else 0.0
    return (pinned + c * dman) / (1.0 + c - alpha * c * dman)


def integrated(n: int, **asked: Any) -> Array:
    """Return the readings (n,), the plant integrated by solve_ivp, `asked` so, from one sample to the next."""
    linear, loop, given = model().linear(), theta_controller(), parameters()
    m = linear.n_blocks
    omega2, sigma2, b = linear.omega_rad_s**2, 2.0 * linear.sigma_1_s, linear.b[:, 0]
    c, c_rate = linear.c[0], linear.c_rate[0]
    poly, trim, iron = given["magnetic-polynomial"], given["constant-torque"][0], given["jiles-atherton"]
    held = 0.0

    def slope(t: float, x: Array) -> Array:
        q, v = x[:m], x[m : 2 * m]
        position, magnetisation = float(c @ q + c_rate @ v), float(x[-1])
        pull = iron[0] * magnetisation + np.polyval(poly, position) + trim
        acceleration = b * (held + pull) - omega2 * q - sigma2 * v
        rate = float(c @ v + c_rate @ acceleration)
        return np.concatenate([v, acceleration, [iron_slope(position, magnetisation, rate > 0.0, iron) * rate]])

    x, blocks, out, wave = np.zeros(2 * m + 1), np.zeros((loop.n_blocks, 2)), np.empty(n), reference()
    dt_s = 1.0 / model().sample_rate_hz
    for k in range(n):
        out[k] = c @ x[:m] + c_rate @ x[m : 2 * m]
        error = wave[k % PERIOD] - out[k]
        held = float(np.sum(loop.c * blocks) + loop.d * error)
        blocks = np.einsum("mij,mj->mi", loop.a, blocks) + loop.b * error
        x = solve_ivp(slope, (0.0, dt_s), x, **asked).y[:, -1]
    return out


def distance(found: Array, exact: Array) -> float:
    """Return the largest difference over the whole of `exact`, relative to the move."""
    return float(np.max(np.abs(found[: exact.size] - exact)) / STEP_RAD)


def check(results: Mapping[str, Any]) -> list[Agreement]:
    """Compare with solve_ivp at a tolerance of 1e-10, and that with itself at 1e-12."""
    exact = results[EXACT]
    # what acts on the structure is taken as a straight line over a sample: of a mode at f it leaves (2 pi f / rate)^2 /
    # 12 of the iron's share, which is a tenth of the springs': at 30 Hz 3e-6. The iron itself is stepped by Heun's rule
    # with an error of 4e-4 of a magnetisation that is a hundredth of the torque
    second_order = "relative to the move; second order in the sample time"
    return [
        Agreement(OURS, distance(results[OURS], exact), EQUAL, second_order),
        Agreement(CONTROL, distance(results[CONTROL], exact), EQUAL, second_order),
        Agreement(FUSED, distance(results[FUSED], exact), EQUAL, second_order),
        Agreement(IVP, distance(results[IVP], exact), EQUAL, "relative to the move; its own tolerance"),
        Agreement(
            FINER, distance(results[FINER], exact), 1e-8, "relative to the move; what the reference itself errs by"
        ),
    ]


def fastest_equal(n: int, exact: Array, error: float) -> str:
    """Return the fastest of `SETTINGS` whose error over `n` samples is at most `error`, else the most accurate."""
    seconds, errors = {}, {}
    for name, asked in SETTINGS.items():
        started = time.process_time()
        errors[name] = distance(integrated(n, **asked), exact)
        seconds[name] = time.process_time() - started
    equal = [name for name in SETTINGS if errors[name] <= error]
    return min(equal, key=seconds.__getitem__) if equal else min(SETTINGS, key=errors.__getitem__)


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return ours, the peers and the exact one; solve_ivp is asked for no more accuracy than ours has."""
    n, few = (QUICK, QUICK_PEERS) if quick else (SAMPLES, PERIOD)
    systems, time_s = {CONTROL: connected(), FUSED: fused()}, np.arange(few) / model().sample_rate_hz
    wave = reference()[np.arange(few) % PERIOD]
    exact = integrated(few, rtol=1e-10, atol=1e-14)
    error = distance(ours(n), exact)
    machine.wait()  # its effects are inlined from now on
    chosen = fastest_equal(few, exact, error)

    def controlled(name: str) -> Contender:
        system = systems[name]
        return Contender(name, lambda: np.asarray(control.input_output_response(system, time_s, wave).outputs), few)

    def finer() -> Array:
        return integrated(few, method="DOP853", rtol=1e-12, atol=1e-15)

    facts = {"samples of ours": n, "samples of the peers": few, "samples of a period": PERIOD}
    return Prepared(
        (
            Contender(OURS, lambda: ours(n), n),
            controlled(CONTROL),
            controlled(FUSED),
            Contender(IVP, lambda: integrated(few, **SETTINGS[chosen]), few, rounds=3, warm=0),
            Contender(EXACT, lambda: integrated(few, rtol=1e-10, atol=1e-14), few, rounds=1, warm=0),
            Contender(FINER, finer, few, rounds=1, warm=0),
        ),
        check,
        {},
        facts | {"solve_ivp, the fastest as accurate as ours": chosen, "control": version_of("control")},
    )


BENCHMARK = Benchmark(
    name="nonlinear-loop",
    work="θx in closed loop at 10 kHz with hysteresis and magnetic polynomial, chopping",
    prepare=prepare,
    one_core=True,
    targets=(
        times_faster(OURS, CONTROL, 1000.0),
        times_faster(OURS, FUSED, 1000.0),
        times_faster(OURS, IVP, 1000.0),
    ),
    missed={
        times_faster(OURS, FUSED, 1000.0).what: (
            "Written by hand as one system, the loop spares python-control all that it is there for: a sample is one "
            "Python function with a dozen small numpy calls. A thousandth of that is some 38 ns, 130 cycles; ours "
            "takes 54 ns, of which leaving out the magnetic hysteresis saves 28 (and all three effects 39): two "
            "stages, each a division and a dozen products that wait for one another, between a position and the next."
        )
    },
)
