"""What an identification is: the model file with standard deviations, and how well it does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np
from numpy.typing import NDArray

from analysis.identification.dropped import Dropped
from analysis.identification.mode_axes import axes_of_modes
from analysis.identification.mode_remarks import remarks_on_modes
from analysis.identification.response_curves import ResponseCurve
from analysis.identification.response_fit import RationalFit
from analysis.identification.static_gain import StaticGain, static_gain, static_gain_std
from analysis.identification.timefit import TimeFit
from campaigns.log import Run
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import ModalModel
from sim_backend.model import EffectEntry, Intersample, Model, Port, Quantity, check_model, from_linear
from sim_backend.plausible import LARGEST

Array = NDArray[np.float64]


TABLE = "frequency-response table"
"""The method of what was fitted to no record."""


@dataclass(frozen=True)
class HeldOut:
    """Error of the simulation on one held-out segment: its rms over that of the output, per output and over all."""

    run_uid: str
    segment: str
    per_output: dict[str, float]
    total: float


@dataclass(frozen=True)
class Identification:
    """A model identified from logs; `modes` lists frequency and decay rate with standard deviations, per mode.

    `chi2_per_dof` is near 1 when noise explains the misfit, and None where all lines were weighed alike. `noise` and
    `distortion` are relative to the output (rms), where the excitation determines them. `noise_is_bound` tells that the
    record began in another motion, of which a part may still be in the noise. `held_out` may be empty.
    `response` is what was measured by frequency, before any model; empty for a record that is fitted in time. `remarks`
    say what of the records was left out or is uncertain. `gains` are empty where a rigid body has none; `axes` has
    those of each of the `modes`.
    """

    model: Model
    method: str
    modes: tuple[dict[str, float], ...]
    chi2_per_dof: float | None
    noise: float | None
    distortion: float | None
    held_out: tuple[HeldOut, ...]
    response: tuple[ResponseCurve, ...] = ()
    remarks: tuple[str, ...] = ()
    gains: tuple[StaticGain, ...] = ()
    axes: tuple[str, ...] = ()
    noise_is_bound: bool = False

    @property
    def of_a_table(self) -> bool:
        """Whether it was fitted to a table, whose response is that of a continuous input, with no hold before it."""
        return self.method == TABLE


@dataclass(frozen=True)
class Fitted:
    """A linear model between named channels, its standard deviations in the same shapes, and the quality of the fit.

    `offsets` (records, n_y) is what each output reads where the model is at rest, one row per record; `dropped` are the
    modes that were given up, `gain_std` (n_y, n_u) the deviations of the static gain, where they are known.
    """

    linear: ModalModel
    std: ModalModel
    chi2: float | None
    dof: int
    offsets: Array = field(default_factory=lambda: np.zeros((0, 0)))
    dropped: tuple[Dropped, ...] = ()
    gain_std: Array | None = None


def deviations(fit: TimeFit | RationalFit) -> ModalModel:
    """Return the standard deviations of a fit's numbers in the shapes of its model.

    Of what the data do not determine they may be larger than any number that a file holds, and are the largest then.
    """
    spread = np.minimum(np.sqrt(np.maximum(np.diag(fit.covariance), 0.0)), LARGEST)
    names = ("b", "b_direct", "c", "c_rate", "d", "delay_s")
    arrays = {key: spread[fit.layout.index(key)] for key in names}
    omega, sigma = np.minimum(fit.omega_std_rad_s, LARGEST), np.minimum(fit.sigma_std_1_s, LARGEST)
    return ModalModel(omega_rad_s=omega, sigma_1_s=sigma, **arrays)


def fitted_by(
    fit: TimeFit | RationalFit,
    chi2: float | None,
    dof: int,
    offsets: Array | None = None,
    before: tuple[Dropped, ...] = (),
) -> Fitted:
    """Return what a fit found, its misfit as given and `offsets` (runs, n_y); modes were given up `before` it."""
    rest = np.zeros((0, 0)) if offsets is None else offsets
    return Fitted(fit.model, deviations(fit), chi2, dof, rest, (*before, *fit.dropped), static_gain_std(fit))


def side_by_side(
    models: Sequence[ModalModel], drives: Sequence[Sequence[int]], readings: Sequence[Sequence[int]]
) -> ModalModel:
    """Return one model with the blocks of all, given which inputs and outputs of the whole are those of each.

    Every output is one model's. An input may be several models': it is late by the largest of their delays.
    """
    n_u, n_y = (1 + max(max(some) for some in places) for places in (drives, readings))
    m = sum(model.n_blocks for model in models)
    whole = {key: np.zeros((m, n_u)) for key in ("b", "b_direct")} | {
        key: np.zeros((n_y, m)) for key in ("c", "c_rate")
    }
    direct, late, at = np.zeros((n_y, n_u)), np.zeros(n_u), 0
    for model, columns, rows in zip(models, drives, readings, strict=True):
        own = range(at, at := at + model.n_blocks)
        for key in ("b", "b_direct"):
            whole[key][np.ix_(own, columns)] = getattr(model, key)
        for key in ("c", "c_rate"):
            whole[key][np.ix_(rows, own)] = getattr(model, key)
        direct[np.ix_(rows, columns)] = model.d
        late[columns] = np.maximum(late[columns], model.delay_s)
    flat = {key: np.concatenate([getattr(model, key) for model in models]) for key in ("omega_rad_s", "sigma_1_s")}
    return ModalModel(**flat, **whole, d=direct, delay_s=late)


def identification(
    fitted: Fitted,
    runs: Sequence[Run],
    inputs: list[Port],
    outputs: list[Port],
    *,
    method: str,
    name: str,
    intersample: Intersample = "held",
    levels: tuple[float | None, float | None] = (None, None),
    held_out: tuple[HeldOut, ...] = (),
    response: tuple[ResponseCurve, ...] = (),
    rate_hz: float | None = None,
    source: str | None = None,
) -> Identification:
    """Return the identification that a fit to `runs` amounts to; `levels` are noise and distortion over the output.

    What was fitted to no run has a `rate_hz` and a `source` of its own.
    """
    linear, std = fitted.linear, fitted.std
    # a delay that was chosen among whole samples is known to a part of one: any part is as likely
    chosen = (linear.delay_s > 0.0) & (std.delay_s == 0.0)
    if runs and np.any(chosen):
        std = std.with_(delay_s=np.where(chosen, 1.0 / (runs[0].sample_rate_hz * np.sqrt(12.0)), std.delay_s))
    source = source or f"{method} fit to run {', '.join(run.run_uid for run in runs)}"
    model = from_linear(
        linear,
        name=name,
        title=f"identified from {len(runs)} run{'s' if len(runs) > 1 else ''} ({method})" if runs else source,
        sample_rate_hz=rate_hz or runs[0].sample_rate_hz,
        inputs=inputs,
        outputs=outputs,
        origin="fitted",
        source=source,
        std=std,
    )
    model = msgspec.structs.replace(model, intersample=intersample)
    try:
        check_model(model, "the identified model")
    except ConfigError as error:
        raise DataError(f"{error}; the data do not determine it: give fewer modes with --modes") from None
    if np.any(fitted.offsets) and any(run.header.bench.get("kind") == "imported" for run in runs):
        model = msgspec.structs.replace(model, effects=sensor_zeros(fitted.offsets, outputs, source))
    rising = np.argsort(linear.omega_rad_s).tolist()
    axes = axes_of_modes(linear, [port.dof for port in outputs])
    chi2_per_dof = None if fitted.chi2 is None else fitted.chi2 / max(fitted.dof, 1)
    remarks = remarks_on_modes(linear, std, fitted.dropped)
    return Identification(
        model,
        method,
        tuple(_mode(linear, std, i) for i in rising),
        chi2_per_dof,
        *levels,
        held_out,
        response,
        remarks,
        gains=_gains(fitted, inputs, outputs),
        axes=tuple(axes[i] for i in rising),
    )


def _mode(linear: ModalModel, std: ModalModel, i: int) -> dict[str, float]:
    per_hz = 1.0 / (2.0 * np.pi)
    return {
        "frequency_hz": float(linear.omega_rad_s[i] * per_hz),
        "frequency_std_hz": float(std.omega_rad_s[i] * per_hz),
        "decay_rate_1_s": float(linear.sigma_1_s[i]),
        "decay_rate_std_1_s": float(std.sigma_1_s[i]),
    }


def _gains(fitted: Fitted, inputs: list[Port], outputs: list[Port]) -> tuple[StaticGain, ...]:
    """Return the static gain of every entry."""
    gain, std = static_gain(fitted.linear), fitted.gain_std
    if gain is None:
        return ()
    return tuple(
        StaticGain(
            i.name,
            o.name,
            f"{o.unit} per {i.unit}",
            float(gain[k, j]),
            None if std is None or not np.isfinite(std[k, j]) else float(std[k, j]),
        )
        for k, o in enumerate(outputs)
        for j, i in enumerate(inputs)
    )


def sensor_zeros(offsets: Array, outputs: list[Port], source: str) -> list[EffectEntry]:
    """Return the operating point of each output as an effect: a bench of others counts from a zero of its own.

    `offsets` is (realisations, n_y).
    """
    mean = offsets.mean(axis=0)
    std = offsets.std(axis=0, ddof=1) / np.sqrt(offsets.shape[0]) if offsets.shape[0] > 1 else None
    return [
        EffectEntry(
            effect="sensor-offset",
            where=port.dof,
            parameters={
                "offset": Quantity(
                    value=float(mean[i]), origin="fitted", source=source, std=None if std is None else float(std[i])
                )
            },
            note="operating point of the recorded output, not physics",
        )
        for i, port in enumerate(outputs)
        if mean[i] != 0.0
    ]
