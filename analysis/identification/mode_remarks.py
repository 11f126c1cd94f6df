"""What has to be said of a model's modes: undetermined numbers, two modes in one place, modes given up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from analysis.identification.determined import SIGNIFICANT, same_place
from analysis.identification.dropped import MERGED, Dropped
from sim_backend.linear import Array, ModalModel

_TWICE = 2.0
"""Ratio of decay rates up to which a mode stands for one that was given up in its place."""

_LEAST = float(np.finfo(float).tiny)


def remarks_on_modes(model: ModalModel, std: ModalModel, dropped: Sequence[Dropped] = ()) -> tuple[str, ...]:
    """Return in words which modes of `model` are doubtful, by the deviations `std`, and which were given up."""
    return (*_undetermined(model, std), *_in_one_place(model), *_given_up(model, dropped))


def name_of(model: ModalModel, i: int) -> str:
    """Return the label that block `i` has in the model file, with its frequency."""
    return f"mode {i + 1} ({_hz(model.omega_rad_s)[i]:.4g} Hz)"


def _undetermined(model: ModalModel, std: ModalModel) -> Iterator[str]:
    for i in range(model.n_blocks):
        frequency = f"frequency {_hz(model.omega_rad_s)[i]:.4g} ± {_hz(std.omega_rad_s)[i]:.2g} Hz"
        decay = f"decay rate {model.sigma_1_s[i]:.4g} ± {std.sigma_1_s[i]:.2g} s⁻¹"
        doubtful = [
            words
            for words, value, deviation in (
                (frequency, model.omega_rad_s[i], std.omega_rad_s[i]),
                (decay, model.sigma_1_s[i], std.sigma_1_s[i]),
            )
            if value > 0.0 and not value >= SIGNIFICANT * deviation
        ]
        if not doubtful:
            continue
        yield (
            f"{name_of(model, i)} is not determined by the data: {', '.join(doubtful)}, below {SIGNIFICANT:g} standard "
            f"deviations{_as_poles(model.omega_rad_s[i], model.sigma_1_s[i])}"
        )


def _as_poles(omega: float, sigma: float) -> str:
    """Return in words what an overdamped block is, nothing for one that swings."""
    if not 0.0 < omega < sigma:
        return ""
    fast = sigma + np.sqrt(sigma**2 - omega**2)
    slow, fast = (pole / (2.0 * np.pi) for pole in (omega**2 / fast, fast))
    return f"; it is overdamped, with poles at {slow:.3g} and {fast:.3g} Hz, one of which may be known"


def _in_one_place(model: ModalModel) -> Iterator[str]:
    for i, j in same_place(model):
        apart = abs(model.omega_rad_s[i] - model.omega_rad_s[j]) / (2.0 * np.pi)
        width = (model.sigma_1_s[i] + model.sigma_1_s[j]) / (2.0 * np.pi)
        yield (
            f"{name_of(model, i)} and {name_of(model, j)} are {apart:.3g} Hz apart, closer than their widths "
            f"({width:.3g} Hz), and act alike: they may be one mode that is not linear; --modes fits fewer"
        )


def _given_up(model: ModalModel, dropped: Sequence[Dropped]) -> Iterator[str]:
    told = [one for one in dropped if one.why == MERGED or not _found_again(model, one)]
    for why in dict.fromkeys(one.why for one in told):
        # one that comes back in the next fit and is given up again is told once
        some = list({f"{one.frequency_hz:.4g}": _numbers(one) for one in told if one.why == why}.values())
        yield f"{len(some)} mode{'s were' if len(some) > 1 else ' was'} given up, {why}: {', '.join(some)}"


def _numbers(one: Dropped) -> str:
    share = "" if one.explained is None else f", explained {100.0 * one.explained:.2g} % of the squared residual"
    return (
        f"{one.frequency_hz:.4g} ± {one.frequency_std_hz:.2g} Hz "
        f"(decay rate {one.decay_rate_1_s:.3g} ± {one.decay_rate_std_1_s:.2g} s⁻¹{share})"
    )


def _found_again(model: ModalModel, one: Dropped) -> bool:
    """Tell whether a mode stands in the place of one that was given up: a later fit has put it there again."""
    apart = np.abs(_hz(model.omega_rad_s) - one.frequency_hz)
    alike = np.abs(np.log(np.maximum(model.sigma_1_s, _LEAST) / max(one.decay_rate_1_s, _LEAST))) < np.log(_TWICE)
    return bool(np.any((apart < model.sigma_1_s / (2.0 * np.pi)) & alike))


def _hz(omega_rad_s: Array) -> Array:
    return np.asarray(omega_rad_s / (2.0 * np.pi))
