"""Poles that grow by themselves, seen in a frequency response: the models fitted here have none.

A plant that is unstable can be measured in a loop that holds it. A fit of stable poles reflects what grows into what
decays, with the right magnitude and the wrong phase.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.frequency.frf_records import frequency_response_welch
from analysis.identification.determined import LEAVES
from analysis.identification.held_out import channels_of
from analysis.identification.modelled_response import response_of
from analysis.identification.response_curves import ResponseCurve
from analysis.identification.vector_fitting import PoleResidues, vector_fit
from campaigns.log import LogSegment, Run
from sim_backend.errors import DataError
from sim_backend.linear import Array, ComplexArray
from sim_backend.model import Model

HEARD = 0.3
"""Deviation of a line over its response up to which it tells of the plant: the phase is then known to 20 degrees."""

LEAST_LINES = 20

_NOTHING = 1e-300

PIECES = 8
"""Half-overlapping pieces of a record that are averaged."""

DRIVEN = 1e-3
"""Power of the input that the reference causes, over the largest, from which on a line tells of the plant."""


@dataclass(frozen=True)
class Growing:
    """A pole whose real part `growth_1_s` is positive; without it the squared misfit is `clearer` times larger."""

    growth_1_s: float
    frequency_hz: float
    clearer: float


def growing_pole(
    frequency_hz: Array,
    response: ComplexArray,
    std: Array,
    modelled: ComplexArray,
    blocks: int,
    hold_rate_hz: float | None,
) -> Growing | None:
    """Return the growing pole of a response (n_f,) with deviations `std`, None where stable poles do as well.

    Poles wherever they are best, up to one block more than the model has, are compared with as many stable ones and
    with the response of the model. As for a mode, half of the squared misfit must be explained (`determined.LEAVES`).
    Poles beyond the highest line are not judged.
    """
    kept = (frequency_hz > 0.0) & (std < HEARD * np.abs(response))
    f, g, weight = frequency_hz[kept], response[kept], 1.0 / std[kept]
    own = float(np.sum(np.abs(weight * (modelled[kept] - g)) ** 2))
    # of complex noise each line adds two: what the model explains needs no other poles
    if f.size < LEAST_LINES or own <= LEAVES * 2.0 * f.size:
        return None
    best: tuple[float, float, PoleResidues] | None = None
    for count in range(2, 2 * min(blocks + 1, (f.size - 1) // 8) + 1, 2):
        try:
            held, free = (
                vector_fit(f, g[:, None, None], count, weight[:, None, None], hold_rate_hz, stable=stable)
                for stable in (True, False)
            )
        except np.linalg.LinAlgError:
            continue
        costs = [_cost(one, f, g, weight, hold_rate_hz) for one in (held, free)]
        criterion = 2.0 * f.size * np.log(max(costs[1], _NOTHING)) + (2 * count + 1) * np.log(2.0 * f.size)
        if best is None or criterion < best[0]:
            best = float(criterion), costs[0] / max(costs[1], _NOTHING), free
    if best is None:
        return None
    _, clearer, free = best
    clearer = min(clearer, own / max(_cost(free, f, g, weight, hold_rate_hz), _NOTHING))
    inside = (free.poles.real > 0.0) & (free.poles.imag >= 0.0) & (np.abs(free.poles) < 2.0 * np.pi * f[-1])
    if not inside.any() or not clearer > LEAVES:
        return None
    # of several the one that is missed most when it is reflected: others may stand where nothing is
    missed = {complex(p): _without(free.poles, p, f, g, weight, hold_rate_hz) for p in free.poles[inside]}
    worst = max(missed, key=lambda p: missed[p])
    if not missed[worst] > LEAVES * _cost(free, f, g, weight, hold_rate_hz):
        return None
    return Growing(worst.real, worst.imag / (2.0 * np.pi), clearer)


def _without(
    poles: ComplexArray,
    growing: complex,
    frequency_hz: Array,
    response: ComplexArray,
    weight: Array,
    hold_rate_hz: float | None,
) -> float:
    """Return the squared misfit of a response with one `growing` pole reflected and all residues fitted anew."""
    mirrored = np.where(poles.imag >= 0.0, poles, np.nan)
    mirrored = np.where(mirrored == growing, -np.conj(mirrored), mirrored)
    columns = [np.ones(frequency_hz.size, dtype=complex)]
    for p in mirrored[np.isfinite(mirrored)].tolist():
        terms = _fractions(np.array([p, np.conj(p)]), frequency_hz, hold_rate_hz)
        columns += [terms.sum(axis=1)] if p.imag == 0.0 else [terms.sum(axis=1), 1j * (terms[:, 0] - terms[:, 1])]
    system, goal = np.stack(columns, axis=1) * weight[:, None], weight * response
    system = system / np.linalg.norm(system, axis=0)
    tall, target = np.concatenate([system.real, system.imag]), np.concatenate([goal.real, goal.imag])
    return float(np.sum((tall @ np.linalg.lstsq(tall, target, rcond=None)[0] - target) ** 2))


def _fractions(poles: ComplexArray, frequency_hz: Array, hold_rate_hz: float | None) -> ComplexArray:
    """Return 1 / (s - pole) at all frequencies (n_f, n), behind a hold where there is one."""
    s = 2j * np.pi * frequency_hz[:, None]
    if hold_rate_hz is None:
        return np.asarray(1.0 / (s - poles))
    late = poles / hold_rate_hz
    return np.asarray(np.expm1(late) / poles / (np.exp(s / hold_rate_hz) - np.exp(late)))


def _cost(
    found: PoleResidues, frequency_hz: Array, response: ComplexArray, weight: Array, hold_rate_hz: float | None
) -> float:
    terms = found.residues[:, 0, 0] * _fractions(found.poles, frequency_hz, hold_rate_hz)
    return float(np.sum(np.abs(weight * (terms.sum(axis=1) + found.d[0, 0] - response)) ** 2))


def remarks_on_growth(model: Model, curves: Sequence[ResponseCurve], *, continuous: bool = False) -> tuple[str, ...]:
    """Return in words the pole that grows fastest in any of the measured curves, none where none is certain."""
    found = []
    late = dict(zip([port.name for port in model.inputs], model.linear().delay_s.tolist(), strict=True))
    inputs, outputs = ([port.name for port in ports] for ports in (model.inputs, model.outputs))
    hold = None if continuous or model.intersample == "band-limited" else model.sample_rate_hz
    for curve in curves:
        f = curve.frequency_hz
        early = np.exp(2j * np.pi * f * late[curve.input])
        modelled = response_of(model, f, continuous=continuous)
        own = modelled[:, outputs.index(curve.output), inputs.index(curve.input)]
        response = curve.magnitude * np.exp(1j * curve.phase_rad)
        pole = growing_pole(f, response * early, _deviation(curve), own * early, len(model.modes), hold)
        if pole is not None:
            found.append((pole, curve))
    if not found:
        return ()
    pole, curve = max(found, key=lambda one: one[0].growth_1_s)
    return (
        f"the plant is unstable: the response {curve.input} → {curve.output} has a pole that grows by "
        f"{pole.growth_1_s:.4g} s⁻¹ at {pole.frequency_hz:.4g} Hz, and stable poles alone leave "
        f"{pole.clearer:.3g} times the squared misfit. This model has stable poles only and is wrong: do not use it",
    )


def _deviation(curve: ResponseCurve) -> Array:
    """Return the deviation of each line (n_f,), not below a thousandth of the response; that where it is unknown."""
    least = 1e-3 * np.maximum(curve.magnitude, np.finfo(float).tiny)
    return np.asarray(np.where(np.isfinite(curve.std), np.maximum(curve.std, least), least))


def curves_in_a_loop(parts: Sequence[tuple[Run, LogSegment]]) -> Iterator[ResponseCurve]:
    """Yield the response of each output of a plant with one input in a loop, by its reference: noise cancels.

    The response from the reference to the output over that to the input (the indirect method) is that of the plant
    whatever the loop does. Nothing is yielded of a loop without one reference for its one input.
    """
    run, segment = max(parts, key=lambda part: part[1].rows)
    if len(run.names("reference")) != 1 or len(run.names("input")) != 1:
        return
    r, u, y = (channels_of(run, segment, role) for role in ("reference", "input", "output"))
    r, both = r - r.mean(axis=0), np.hstack([u - u.mean(axis=0), y - y.mean(axis=0)])
    piece = 2 * segment.rows // (PIECES + 1)
    try:
        measured = frequency_response_welch(r, both, run.sample_rate_hz, piece)
    except DataError:
        return
    spectrum = np.abs(np.fft.rfft(r[:piece, 0] - r[:piece, 0].mean())) ** 2
    power = np.interp(measured.frequency_hz, np.fft.rfftfreq(piece, 1.0 / run.sample_rate_hz), spectrum)
    to_input, variance = measured.response[:, 0, 0], measured.noise_variance[:, :, 0]
    power = power * np.abs(to_input) ** 2
    driven = power > DRIVEN * power.max()
    for k, name in enumerate(run.names("output"), start=1):
        response = measured.response[:, k, 0] / to_input
        error = np.sqrt(0.5 * (variance[:, k] + np.abs(response) ** 2 * variance[:, 0])) / np.abs(to_input)
        arrays = (measured.frequency_hz, np.abs(response), np.angle(response), error, error)
        yield ResponseCurve(name, run.names("input")[0], *(values[driven] for values in arrays))
