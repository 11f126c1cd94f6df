"""The nominal model's own parameters: which may be adjusted, how far each is trusted, what its change looks like.

Each mode has a logarithmic frequency, a logarithmic decay rate, and logarithms of its participations (those that are
not zero; the largest output participation of each mode is fixed, because only products matter). Their prior is a normal
distribution of the tolerance the nominal model claims, so a wrong gain of one per cent is never taken for physics, and
a shift far beyond the tolerance stays visible as one.

Every number that a model states has a relative error of its own, independent of all others. Of a mode's participations
only products of an input's and an output's matter, so the largest output participation c₀ is fixed, and the nuisances
of the others stand for b c₀ and c / c₀: ln b moves by ε_b + ε_0 and ln c by ε_c - ε_0. So the unknown error ε_0 of the
fixed one is in all of them, as given by a nuisance's `loading`: drives of one mode have a common error, and an output
has it relative to the drives. If they were taken as independent, one sensor whose numbers happen to be all too small
would be a gain of that sensor at several standard deviations.

A model that was fitted to the very runs that are diagnosed has numbers that the runs alone determine, some of them
only noise about zero: a rate's part of a participation, a feedthrough. No factor carries such a number through zero,
so those participations and the feedthrough are adjusted by an added number, and a delay of the fit is adjusted too.
Otherwise an effect of the library that is linear itself would be free where the model is not, and would be named for
the difference from another fit of the model; and the error of a fitted delay could not be undone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy

from analysis.diagnosis.nominal.responses import contrast, response, simulate
from analysis.linear.simulate import delayed, driven_by, weighted
from sim_backend.linear import Array, DiscreteModel, ModalModel, delay_taps, discretise, late_within_samples

_STEP = 1e-5
"""Relative step of finite differences: the square root of rounding at the size of a response, in double precision."""


@dataclass(frozen=True)
class Nuisance:
    """One nuisance parameter, a number of the model that may be adjusted: its `field` and `index` there, and prior sd.

    Its scale is logarithmic, or counts in `unit` where there is one. A direct path and a delay belong to no `mode`: it
    is -1. `loading` is the part in it of the error, of unit size, of the participation that is fixed in its mode.
    """

    field: str
    index: tuple[int, ...]
    mode: int
    sd: float
    unit: float = 0.0
    loading: float = 0.0

    def turned(self, value: float, change: float) -> float:
        """Return the parameter, `value` now, after a `change` on the nuisance's scale."""
        return value + self.unit * change if self.unit else value * float(np.exp(change))

    def change(self, before: float, after: float) -> float:
        """Return the change on the nuisance's scale between two values; none where the scale has none."""
        if self.unit:
            return (after - before) / self.unit
        return float(np.log(after / before)) if after / before > 0.0 else 0.0

    def deviation(self, value: float, std: float) -> float:
        """Return the standard deviation of the parameter at `value` from that on the nuisance's scale."""
        return (self.unit or abs(value)) * std


_FARTHEST = 3.0
"""Nuisances stay within a factor of twenty, e^3, or within three units: a prior alone does not hold them against a
large error of the model."""


OWN_TOLERANCE = 1.0
"""Relative trust in a model that was fitted to the very runs that are diagnosed: whatever they show, its numbers had
to follow, so they say nothing on their own."""


def nuisances_of(linear: ModalModel, tolerance: float) -> list[Nuisance]:
    """Return every adjustable parameter of `linear`, each trusted to the relative `tolerance`.

    So is the participation that is fixed in each mode, unless it is exactly one: that is a scale, which has no error.
    """
    nuisances: list[Nuisance] = []
    for m in range(linear.n_blocks):
        for name in ("omega_rad_s", "sigma_1_s"):
            if getattr(linear, name)[m] > 0.0:
                nuisances.append(Nuisance(name, (m,), m, tolerance))
        shares = [("c", i) for i in range(linear.n_outputs)] + [("c_rate", i) for i in range(linear.n_outputs)]
        present = [(name, i) for name, i in shares if getattr(linear, name)[i, m] != 0.0]
        shared = 0.0
        if present:
            # participation in displacement and rate differ in unit; compare them at the mode's own frequency
            held = max(present, key=lambda s: abs(getattr(linear, s[0])[s[1], m]) * _unit(linear, s[0], m))
            present.remove(held)
            shared = 0.0 if abs(getattr(linear, held[0])[held[1], m]) == 1.0 else tolerance
        nuisances += [Nuisance(name, (i, m), m, tolerance, loading=-shared) for name, i in present]
        nuisances += [
            Nuisance(name, (m, j), m, tolerance, loading=shared)
            for name in ("b", "b_direct")
            for j in range(linear.n_inputs)
            if getattr(linear, name)[m, j] != 0.0
        ]
    return nuisances


def _unit(linear: ModalModel, name: str, m: int) -> float:
    return float(linear.omega_rad_s[m]) if name == "c_rate" else 1.0


def own_nuisances_of(linear: ModalModel, late: Iterable[int] = ()) -> list[Nuisance]:
    """Return every adjustable parameter of a model that was fitted to the very runs that are diagnosed.

    The delays of the inputs numbered in `late` were fitted too; any other is a constant of that fit.

    What is added to a participation counts in the size of the whole, position's part and rate's together, with which
    the mode takes part there; what is added to a feedthrough counts in the largest response of a mode along its path.
    """
    into, out = _sizes(linear)
    time = 1.0 / _pace(linear)
    units = {"b": into, "b_direct": into * time[:, None], "c": out, "c_rate": out * time}
    nuisances = [
        replace(nuisance, unit=float(units[nuisance.field][nuisance.index]), loading=0.0)
        if nuisance.field in units
        else nuisance
        for nuisance in nuisances_of(linear, OWN_TOLERANCE)
    ]
    along = np.max(out[:, :, None] * (into * (time**2)[:, None])[None], axis=1, initial=0.0)  # (n_y, n_u)
    for i, j in np.argwhere(linear.d != 0.0):
        unit = max(float(along[i, j]), abs(float(linear.d[i, j])))
        nuisances.append(Nuisance("d", (int(i), int(j)), -1, OWN_TOLERANCE, unit))
    return nuisances + [Nuisance("delay_s", (j,), -1, OWN_TOLERANCE, float(linear.delay_s[j])) for j in late]


def bounds_of(nuisances: Sequence[Nuisance]) -> tuple[Array, Array]:
    """Return the least and the largest change of every nuisance, (n_nuisances,) each: no delay is shorter than none."""
    least = [-1.0 if nuisance.field == "delay_s" else -_FARTHEST for nuisance in nuisances]
    return np.array(least), np.full(len(nuisances), _FARTHEST)


def _pace(linear: ModalModel) -> Array:
    """Return how fast every mode answers, (m,) in rad/s: its frequency or its decay, whatever is faster; never zero."""
    pace = np.maximum(linear.omega_rad_s, 2.0 * linear.sigma_1_s)
    return np.where(pace > 0.0, pace, 1.0)


def _sizes(linear: ModalModel) -> tuple[Array, Array]:
    """Return the sizes with which inputs drive every mode (m, n_u), and with which it shows in outputs (n_y, m)."""
    pace = _pace(linear)
    return np.hypot(linear.b, pace[:, None] * linear.b_direct), np.hypot(linear.c, pace * linear.c_rate)


def turned(linear: ModalModel, nuisances: list[Nuisance], change: Array) -> ModalModel:
    """Return `linear` with every nuisance's parameter adjusted by `change` (n_nuisances,)."""
    moved: dict[str, Array] = {}
    for nuisance, delta in zip(nuisances, change, strict=True):
        values = moved.setdefault(nuisance.field, getattr(linear, nuisance.field).copy())
        values[nuisance.index] = nuisance.turned(values[nuisance.index], delta)
    return linear.with_(**moved)


def deviations(linear: ModalModel, nuisances: list[Nuisance], change_std: Array) -> ModalModel:
    """Return the standard deviations of the parameters of `linear`, in its shapes; zero for what no nuisance turns.

    `change_std` (n_nuisances,) are those of the nuisances on their own scales.
    """
    spread = {f.name: np.zeros_like(getattr(linear, f.name)) for f in fields(linear)}
    for nuisance, std in zip(nuisances, change_std, strict=True):
        spread[nuisance.field][nuisance.index] = nuisance.deviation(
            getattr(linear, nuisance.field)[nuisance.index], std
        )
    return linear.with_(**spread)


def change_to(linear: ModalModel, nuisances: list[Nuisance], changed: ModalModel) -> Array:
    """Return the change (n_nuisances,) of the nuisances of `linear` that makes its parameters those of `changed`.

    Modes that `changed` has beyond those of `linear` are left alone.
    """
    out = np.zeros(len(nuisances))
    for i, nuisance in enumerate(nuisances):
        before, after = (
            getattr(linear, nuisance.field)[nuisance.index],
            getattr(changed, nuisance.field)[nuisance.index],
        )
        out[i] = nuisance.change(before, after)
    return out


@dataclass(frozen=True)
class Turning:
    """Every nuisance of a model adjusted by a small step in both directions, for any number of records.

    `linear` is the model, `whole` it at the rate of the records; `there` and `back` hold, side by side, the own mode of
    each nuisance that has one, adjusted by plus and minus `_STEP`.
    """

    linear: ModalModel
    nuisances: list[Nuisance]
    whole: DiscreteModel
    there: DiscreteModel
    back: DiscreteModel
    through_delay: bool

    def columns(self, u: Array, start: Array) -> Array:
        """Return the change of the outputs per unit of each nuisance, (n, n_y, n_nuisances), by central differences.

        `u` (n, n_u) are commands or, where nothing goes `through_delay`, torques, `start` (m, 2) the states in which
        they find the model. Only the nuisance's own mode is simulated, so that the cost is that of two modes for each;
        a delay's column is the whole model's answer to the slope of what passes it. Each column of each output is one
        stretch of memory: what follows (filters, transforms) works along time.
        """
        # each input is played from one stretch of memory
        forces = np.asfortranarray(driven_by(self.whole, u).forces if self.through_delay else u)
        series = np.zeros((len(self.nuisances), self.linear.n_outputs, u.shape[0]))
        of_mode = 0
        for k, nuisance in enumerate(self.nuisances):
            if nuisance.mode < 0:
                series[k] = self._of_no_mode(nuisance, u).T
                continue
            there, back = (alone(model, of_mode) for model in (self.there, self.back))
            series[k] = contrast(there, back, forces, start[nuisance.mode]).T / (2.0 * _STEP)
            of_mode += 1
        return series.T

    def _of_no_mode(self, nuisance: Nuisance, u: Array) -> Array:
        """Return the column (n, n_y) of a delay or of a direct path."""
        whole, rate_hz, split = self.whole, self.whole.rate_hz, self.whole.late is not None
        if nuisance.field == "delay_s" and split:
            shortest = min(
                _STEP, float(self.linear.delay_s[nuisance.index]) / nuisance.unit
            )  # no delay is shorter than none
            later, sooner = (
                discretise(turned(self.linear, [nuisance], np.array([by])), rate_hz, split=True)
                for by in (_STEP, -shortest)
            )
            return np.asarray((simulate(later, u) - simulate(sooner, u)) / (_STEP + shortest))
        if nuisance.field == "delay_s":
            (source,) = nuisance.index
            taps = delay_taps(float(whole.delay_samples[source]) if self.through_delay else 0.0)
            return response(whole, rate_hz * nuisance.unit * weighted(u[:, source], taps.first, taps.slopes), source)
        output, source = nuisance.index
        # within a sample its first instant counts
        late = np.ceil(whole.delay_samples) if split else whole.delay_samples
        column = np.zeros((u.shape[0], self.linear.n_outputs))
        column[:, output] = nuisance.unit * (delayed(u, late) if self.through_delay else u)[:, source]
        return column


def turning(linear: ModalModel, nuisances: list[Nuisance], rate_hz: float, *, through_delay: bool = True) -> Turning:
    """Return every nuisance of `linear` adjusted both ways at one rate, for `Turning.columns` of any record."""
    split = through_delay and late_within_samples(linear, rate_hz)
    whole = discretise(linear, rate_hz, split=split)
    there, back = (modes_alone(linear, nuisances, by, rate_hz, split=split) for by in (_STEP, -_STEP))
    return Turning(linear, nuisances, whole, there, back, through_delay)


def modes_alone(
    linear: ModalModel, nuisances: Sequence[Nuisance], by: float, rate_hz: float, *, split: bool
) -> DiscreteModel:
    """Return the own mode of each nuisance that has one, adjusted `by` so much, side by side as one model at one rate.

    No mode has a direct term, and each is for the forces that drive the whole model: where delays are `split` every
    command drives it twice, as in `responses.driven_by`. All are made at once, which takes as long as one alone.
    """
    own = [nuisance for nuisance in nuisances if nuisance.mode >= 0]
    modes = [nuisance.mode for nuisance in own]
    moved = {name: getattr(linear, name)[modes] for name in ("omega_rad_s", "sigma_1_s", "b", "b_direct")}
    moved |= {name: getattr(linear, name)[:, modes] for name in ("c", "c_rate")}
    for k, nuisance in enumerate(own):
        at = tuple(
            k if axis == (1 if nuisance.field in ("c", "c_rate") else 0) else i for axis, i in enumerate(nuisance.index)
        )
        values = moved[nuisance.field]
        values[at] = nuisance.turned(values[at], by)
    return _for_forces(linear.with_(**moved), rate_hz, split=split)


def alone(model: DiscreteModel, m: int) -> DiscreteModel:
    """Return block `m` of a model by itself."""
    one = slice(m, m + 1)
    late = None if model.late is None else model.late[one]
    return replace(model, a=model.a[one], b=model.b[one], c=model.c[:, one], rate_c=model.rate_c[:, one], late=late)


def mode_alone(linear: ModalModel, m: int, rate_hz: float, *, split: bool) -> DiscreteModel:
    """Return mode `m` of a model at one rate, without a direct term, for the forces that drive the whole model."""
    return _for_forces(linear.only(np.arange(linear.n_blocks) == m), rate_hz, split=split)


def _for_forces(modes: ModalModel, rate_hz: float, *, split: bool) -> DiscreteModel:
    """Return modes at one rate without their direct term, for what `responses.driven_by` makes of the commands."""
    model = discretise(modes.with_(d=np.zeros_like(modes.d)), rate_hz, split=split)
    return replace(model, b=driven_by(model, np.zeros((0, modes.n_inputs))).b)


def sensitivities(
    linear: ModalModel, nuisances: list[Nuisance], u: Array, rate_hz: float, start: Array, *, through_delay: bool = True
) -> Array:
    """Return the change of the outputs of one record per nuisance, (n, n_y, n_nuisances), see `Turning.columns`."""
    return turning(linear, nuisances, rate_hz, through_delay=through_delay).columns(u, start)


def covariance_of(nuisances: Sequence[Nuisance]) -> Array:
    """Return the covariance (n, n) of the nuisances' changes, each on its own scale."""
    loading, mode = np.array([k.loading for k in nuisances]), np.array([k.mode for k in nuisances])
    together = np.outer(loading, loading) * (mode[:, None] == mode)
    return np.asarray(np.diag(np.array([k.sd for k in nuisances]) ** 2) + together)


def spreads_of(nuisances: Sequence[Nuisance]) -> Array:
    """Return the standard deviation (n,) of each nuisance's change by itself."""
    return np.sqrt(np.diag(covariance_of(nuisances)))


def root_of(nuisances: Sequence[Nuisance]) -> Array:
    """Return W (n, n) that makes unit white numbers of the nuisances' changes: W'W inverts their covariance."""
    return np.asarray(scipy.linalg.solve_triangular(factor_of(nuisances), np.eye(len(nuisances)), lower=True))


def factor_of(nuisances: Sequence[Nuisance]) -> Array:
    """Return the lower factor U (n, n) of the covariance U U'."""
    return np.asarray(np.linalg.cholesky(covariance_of(nuisances)))


def mahalanobis2_of(nuisances: Sequence[Nuisance], change: Array) -> float:
    """Return how far a change (n,) of the nuisances is off: the sum of its squares in units of what is plausible."""
    return float(np.sum((root_of(nuisances) @ change) ** 2))
