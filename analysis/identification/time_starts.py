"""Models of so many blocks from which a fit to time records may begin."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.frequency.frf import smoothed
from analysis.frequency.frf_records import frequency_response_local
from analysis.identification.modal_parameters import Structure
from analysis.identification.rational import fit_rational
from analysis.identification.subspace import subspace_model
from analysis.identification.time_residual import TimeTarget
from sim_backend.errors import MccdError
from sim_backend.linear import Array, ModalModel


def starts_for(target: TimeTarget, blocks: int, structure: Structure) -> Iterator[ModalModel]:
    """Yield starts from local frequency responses and from the subspace method, as far as the records allow them.

    The first are better for modes far below the sample rate, the second for short records and in a loop. Where the
    output drifts so far that all else drowns in it (a rigid body), both are repeated on differences of input and
    output, which the same plant connects.
    """
    inputs, outputs = target.inputs, target.outputs
    for _ in range(3):
        for method in (_response_start, _subspace_start):
            try:
                yield method(inputs, outputs, target.rate_hz, blocks, structure)
            except (MccdError, np.linalg.LinAlgError):
                # the other starts remain; that none is found is told by the caller
                continue
        steps = tuple(np.diff(y, axis=0) for y in outputs)
        # a white sequence grows by sqrt(2) when differenced; what shrinks to a tenth is drift
        if all(np.max(np.std(d, axis=0) / np.std(y, axis=0)) > 0.1 for d, y in zip(steps, outputs, strict=True)):
            return
        inputs, outputs = tuple(np.diff(u, axis=0) for u in inputs), steps


def _response_start(
    inputs: tuple[Array, ...], outputs: tuple[Array, ...], rate_hz: float, blocks: int, structure: Structure
) -> ModalModel:
    """Return a start from the local frequency response of the longest record."""
    longest = int(np.argmax([u.shape[0] for u in inputs]))
    step = max(1, inputs[longest].shape[0] // 8000)
    frf = frequency_response_local(inputs[longest], outputs[longest], rate_hz, step=step)
    return fit_rational(
        frf.frequency_hz,
        frf.response,
        blocks,
        variance=smoothed(frf.variance, 3),
        hold_rate_hz=rate_hz,
        structure=structure,
        iterations=30,
    ).model


def _subspace_start(
    inputs: tuple[Array, ...], outputs: tuple[Array, ...], rate_hz: float, blocks: int, structure: Structure
) -> ModalModel:
    """Return a start from the subspace method, cut down to the structure."""
    model = subspace_model(inputs, outputs, rate_hz, 2 * blocks)
    if structure.form == "mechanical":
        model = model.with_(b_direct=np.zeros_like(model.b_direct), c_rate=np.zeros_like(model.c_rate))
    return model if structure.feedthrough else model.with_(d=np.zeros_like(model.d))
