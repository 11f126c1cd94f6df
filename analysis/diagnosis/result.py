"""What a diagnosis says: the content of `diagnosis.json`, and the arrays that its figures are drawn from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from analysis.diagnosis.calibration import BlindNames, calibrated, counted
from analysis.diagnosis.records.dataset import Dataset
from sim_backend.effects.base import Effect
from sim_backend.effects.words import effect_text
from sim_backend.linear import Array, ModalModel

Verdict = Literal["consistent", "named", "ambiguous", "unknown"]


NOTHING_ADDED = "none"
"""The hypothesis that the model lacks nothing."""


def hypothesis_text(name: str) -> str:
    """Return a hypothesis, slugs joined by +, in words."""
    return "nothing added" if name == NOTHING_ADDED else " and ".join(map(effect_text, name.split("+")))


SELDOM = 0.005
"""How often the error on other held-out samples of the same kind would be smaller than the least that is stated."""


@dataclass(frozen=True)
class Estimate:
    """One fitted parameter with its standard deviation and unit."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Cause:
    """One named cause: effect slug, location, probability, parameters and one sentence that a person can check.

    `posterior` is within the library, `probability` how often names of such a posterior were right.
    """

    effect: str
    where: str
    posterior: float
    parameters: dict[str, Estimate]
    why: str

    @property
    def probability(self) -> float:
        """The calibrated probability that the name is right, below one."""
        return calibrated(self.posterior)

    @property
    def blind(self) -> BlindNames | None:
        """The names in blind cases that the probability is counted in; None where it is the posterior."""
        return counted(self.posterior)


@dataclass(frozen=True)
class Domain:
    """The residual's evidence in one domain (frequency, amplitude, …) of one output of one record.

    `axis` (n,) in `unit`, `level` (n,) the residual's size and `floor` (n,) the noise's at each point; `p_value` is
    calibrated under the noise alone, `where` says in words where it is largest.
    """

    record: str
    output: str
    axis: Array
    unit: str
    level: Array
    floor: Array
    p_value: float
    where: str


@dataclass(frozen=True)
class Remainder:
    """The lack of fit of the named causes: its `share` of the squared error that was more than noise.

    `significance` is the chance of as much in noise alone, `lives` says in words where it is.
    """

    share: float
    significance: float
    lives: str


@dataclass(frozen=True)
class Visible:
    """Smallest size at which these data would have shown an effect at a location in half of all cases.

    The size is the `parameter` by itself, all others of the effect at zero, its shapes where they show best. `natural`
    is the size of such a parameter by the record alone (see `Scales`), in the same unit; None where it has no unit.
    """

    effect: str
    where: str
    parameter: str
    size: float
    unit: str
    natural: float | None = None


@dataclass(frozen=True)
class SegmentGain:
    """The error of one held-out segment before and after, relative to the size of the outputs in that segment."""

    segment: str
    rms_before: float
    rms_after: float


@dataclass(frozen=True)
class OutputGain:
    """What the extension gains in one output over all held-out samples, relative to its own size (rms ÷ rms)."""

    output: str
    rms_before: float
    rms_after: float
    noise_floor: float


@dataclass(frozen=True)
class Gain:
    """What the extension gains on samples that no fit has seen, relative to the outputs' own size (rms ÷ rms).

    `segments` are the held-out ones one by one: levels and waveforms differ in what they gain; `outputs` those that
    move: a cause at one axis gains little in the mean of all. `least_error` is what the error after would hardly fall
    below on other samples of the same kind, `most_noise` what noise, and the errors of adjusted parameters, hardly
    exceed on these. Held-out samples would scale what was added by `times`, which is known to `times_std`. `rms_given`
    is the error of the model as given, before its own numbers were adjusted; None where it is not known.
    """

    held_out: tuple[str, ...]
    rms_before: float
    rms_after: float
    noise_floor: float
    reduction: float
    ci95: tuple[float, float]
    segments: tuple[SegmentGain, ...] = ()
    outputs: tuple[OutputGain, ...] = ()
    least_error: float = 0.0
    most_noise: float = 0.0
    times: float = 1.0
    times_std: float = np.inf
    rms_given: float | None = None

    @property
    def likelier(self) -> bool:
        """Whether the error after is likelier to be noise than the one before: where noise is slow, it may be larger.

        A change of `times` its best size lowers the whitened squares where it is less than twice as large as that.
        """
        return self.times > 0.5 and bool(np.isfinite(self.times_std))

    @property
    def measurable(self) -> bool:
        """Whether it is larger than what noise alone makes of the reduction, in either direction."""
        return not self.ci95[0] <= 0.0 <= self.ci95[1]


@dataclass(frozen=True)
class NextExperiment:
    """The plan that best separates what is tied, with the settings that differ from its defaults.

    `expected_sigma` is the separation it is predicted to give between the two hypotheses that are hardest to tell
    apart, `duration_s` the time it takes on the bench.
    """

    test: str
    settings: dict[str, Any]
    separates: tuple[str, ...]
    expected_sigma: float
    duration_s: float = 0.0


@dataclass(frozen=True)
class Choice:
    """What to do next, or None, with the reason."""

    experiment: NextExperiment | None
    reason: str


@dataclass(frozen=True)
class Diagnosis:
    """Everything that was found; `analysis.diagnosis.answer.output` turns it into JSON, an extended model and a page.

    `before` and `after` hold each record's residuals (n, n_y) under the tuned nominal and under the extended model;
    `nominal` is the model given, `linear` the adjusted one that goes with `effects`; `considered` lists rival
    hypotheses, `NOTHING_ADDED` among them, with their evidence relative to the best (natural logarithm), best first.
    `linear_std` holds the standard deviations of the adjusted numbers in the shapes of `linear` (a ModalModel used as a
    container), where known. `sensitivity` lists every effect that may be added to those found; empty where the error is
    not weighed by noise. `adjusted` is the model given with its own numbers fitted and nothing added, None where it is
    not known; they are trusted to `tolerance`, a relative standard deviation of each, None where they were fitted to
    these very runs and are adjusted freely.
    `zeros` states how far each output's zero, fitted to the same runs, is off, with its standard deviation. Where the
    model is wrong by many times the noise, every sample counts alike (`even`), and the noise that `evidence` is in
    units of is estimated from `before`; elsewhere from `after`.
    """

    verdict: Verdict
    sentence: str
    causes: tuple[Cause, ...]
    ambiguous: tuple[tuple[str, ...], ...]
    evidence: dict[str, tuple[Domain, ...]]
    gain: Gain | None
    next_experiment: NextExperiment | None
    data: Dataset
    nominal: ModalModel
    linear: ModalModel
    effects: tuple[Effect, ...]
    before: tuple[Array, ...]
    after: tuple[Array, ...]
    considered: tuple[tuple[str, float], ...] = ()
    notes: tuple[str, ...] = field(default=())
    linear_std: ModalModel | None = None
    remainder: Remainder | None = None
    sensitivity: tuple[Visible, ...] = ()
    zeros: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    even: bool = False
    adjusted: ModalModel | None = None
    tolerance: float | None = None
