"""What held-out rows say against a verdict where nothing repeats.

The noise is then taken from what the model leaves. A model that explains nothing leaves everything, and no search finds
more than noise in that; causes that follow the fitted rows and no others have bent themselves to them. Rows that no fit
has seen tell of both. Noise that a bench has by itself is steady: what is not, and is most of the output, is not taken
for it.
"""

from __future__ import annotations

from dataclasses import replace

from analysis.diagnosis.result import Gain
from analysis.diagnosis.verdict.judging import Judgement

_MOST = 0.5
"""Part of the squared output from which on what the model leaves of it is most of it."""

_ABOVE = 2.0
"""Times the noise, as rms, from which on three quarters of what is left in squares are none."""


def barely_explained(gain: Gain | None) -> bool:
    """Tell whether the model leaves most of the held-out output."""
    return gain is not None and gain.rms_before**2 > _MOST


def doubted(judgement: Judgement, gain: Gain | None, repeats: bool, unsteady: str) -> Judgement:
    """Return `judgement`, or *unknown* with the reason where held-out rows speak against it.

    `repeats` tells whether noise is known from repetitions, `unsteady` in words where the residual is no steady noise;
    nothing where it is. A *consistent* model must not leave most of the output in what is no steady noise; causes that
    are *named* must gain something, or leave little beside noise.
    """
    against = ""
    if repeats or gain is None:
        return judgement
    if judgement.verdict == "consistent" and unsteady and barely_explained(gain):
        against = "the model leaves most of the held-out output, and what it leaves is no steady noise"
    if judgement.verdict == "named" and not gain.measurable and gain.rms_after > _ABOVE * gain.noise_floor:
        against = (
            "the best explanation follows the rows that it was fitted to and no others: it gains nothing on the "
            "held-out ones, and leaves more than noise of them"
        )
    return replace(judgement, verdict="unknown", named=(), tied=(), objection=against) if against else judgement
