"""Identification of a sum of second-order blocks from time records: subspace start, prediction-error refinement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.identification.dropped import Dropped
from analysis.identification.growth import grown
from analysis.identification.modal_parameters import Layout, Structure, determined, layout_of, pack, step_limit, unpack
from analysis.identification.normal_equations import Normal, covariance, minimise
from analysis.identification.rational import require_blocks
from analysis.identification.time_residual import (
    TimeTarget,
    model_outputs,
    nuisances,
    time_normal_equations,
    whitened_cost,
)
from analysis.identification.time_starts import starts_for
from analysis.identification.whitening import holds_inputs, whitening_filters
from analysis.linear.modal_form import canonical
from campaigns.progress import Report, part_of, unheard
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import Array, ModalModel

_PATIENCE = 2
"""Numbers of blocks in succession that may be no better before the search for their number ends."""

_COARSE = 1e-6
"""Relative decrease of the squared error that ends a fit whose only purpose is to be compared: of 10⁵ samples a tenth
of one degree of freedom, where a mode more has to be worth dozens."""

_HOPELESS = 100.0
"""Squared error over that of the best start so far from which on a start is not followed to its end: an error ten times
as large is not made up for by where a fit goes from there, nor by the colour of the noise."""

_NOTHING = 1e-6
"""Part of its motion that a spring takes back in a record, below which there is none."""


@dataclass(frozen=True)
class TimeFit:
    """A model of some structure fitted to time records, with its uncertainty.

    `covariance` (p, p) belongs to the vector of `modal_parameters.pack(model)`; `omega_std_rad_s` and `sigma_std_1_s`
    (m,) are drawn from it. `outputs` are the modelled records (n, n_y), from the estimated `initial_states` (m, 2) with
    the `offsets` (n_y,). `noise_std` (n_y,) is that of the one-step innovation and `whitening` (n_y, p + 1) the filter
    that makes the residual white with unit variance. `criterion` is the Bayesian information criterion, `orders` the
    numbers of blocks tried with theirs, `dropped` the modes that were given up.
    """

    model: ModalModel
    structure: Structure
    layout: Layout
    covariance: Array
    omega_std_rad_s: Array
    sigma_std_1_s: Array
    outputs: tuple[Array, ...]
    initial_states: tuple[Array, ...]
    offsets: tuple[Array, ...]
    noise_std: Array
    whitening: Array
    chi2: float
    dof: int
    criterion: float
    converged: bool
    orders: tuple[tuple[int, float], ...]
    dropped: tuple[Dropped, ...] = ()


@dataclass(frozen=True)
class Compared:
    """Where one start led, with white errors: `criterion` and `squared_error`, each output weighted by its own size."""

    model: ModalModel
    criterion: float
    squared_error: float


def fit_records(
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    rate_hz: float,
    blocks: int | tuple[int, ...],
    *,
    structure: Structure | None = None,
    noise_order: int | None = None,
    rigid_bodies: int | None = 0,
    start: ModalModel | None = None,
    iterations: int = 100,
    in_loop: bool = False,
    compared: dict[bytes, Compared] | None = None,
    report: Report = unheard,
) -> TimeFit:
    """Return the ModalModel behind a zero-order hold that explains records of any waveform best.

    Shapes: every record's input (n, n_u) and output (n, n_y), all at `rate_hz`. Each record's initial state and each
    output's offset are estimated with the model. `noise_order` is the order of the autoregression that whitens each
    output's error (0: white; None: chosen by the Bayesian information criterion); with it the fit is a prediction-error
    fit, which feedback of the noise into the input does not bias. `in_loop` says that there is such feedback: starts
    are then compared as predictions. `compared` keeps where starts of the same records and structure led. `blocks` and
    `rigid_bodies` are as in `rational.fit_rational`. Raises ConfigError or DataError when the records cannot be used.
    """
    target = _target(inputs, outputs, rate_hz)
    structure = structure or Structure()
    wanted = (blocks,) if isinstance(blocks, int) else tuple(sorted(blocks))
    require_blocks(wanted)
    tried: list[tuple[int, float]] = []
    best: TimeFit | None = None
    last: TimeFit | None = None
    worse, least = 0, np.inf
    compared = {} if compared is None else compared
    for i, count in enumerate(wanted):
        told = part_of(report, sum(wanted[:i]) / sum(wanted), sum(wanted[: i + 1]) / sum(wanted))
        starts = [start] if start is not None else list(starts_for(target, count, structure))
        if start is None:
            mechanical = structure.form == "mechanical"
            smaller = [one for one in (best, None if last is best else last) if one is not None]
            starts += [grown(target, one.model, one.outputs, count, mechanical=mechanical) for one in smaller]
        if not starts:
            few = f"{target.values} output values give no start for {count} blocks"
            raise DataError(f"{few}; record more or ask for fewer blocks")
        if in_loop:
            last, missed = _best_prediction(target, starts, structure, noise_order, rigid_bodies, iterations, told)
        else:
            near = _near(target, starts, structure, rigid_bodies, iterations, compared, told)
            last, missed = _best_of(near, target, structure, noise_order, iterations, told)
        tried.append((count, last.criterion))
        better = best is None or last.criterion < best.criterion
        best, worse = (last, 0) if better else (best, worse + 1)
        closer, least = missed < least, min(missed, least)
        assert best is not None
        # two modes may be significant together where neither is by itself, and coloured noise absorbs either
        pair = len(tried) > 2 or count - best.model.n_blocks > 1
        if worse and pair and (worse == _PATIENCE or not (closer or _misses_a_mode(target, best))):
            break
    assert best is not None
    return replace(best, orders=tuple(tried))


def _misses_a_mode(target: TimeTarget, fit: TimeFit) -> bool:
    """Tell whether the inputs explain some of what a fit leaves."""
    return holds_inputs([y - m for y, m in zip(target.outputs, fit.outputs, strict=True)], target.inputs)


def with_one_more(fit: TimeFit, inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float) -> TimeFit:
    """Fit one more block than `fit` has, which starts at its largest residual; shapes as in `fit_records`."""
    structure = fit.structure
    target, count = _target(inputs, outputs, rate_hz), fit.model.n_blocks + 1
    start = grown(target, fit.model, fit.outputs, count, mechanical=structure.form == "mechanical")
    return fit_records(inputs, outputs, rate_hz, count, structure=structure, rigid_bodies=None, start=start)


def _best_prediction(
    target: TimeTarget,
    starts: list[ModalModel],
    structure: Structure,
    noise_order: int | None,
    rigid_bodies: int | None,
    iterations: int,
    report: Report,
) -> tuple[TimeFit, float]:
    """Return the best fit from any start and number of rigid bodies allowed, and its criterion.

    In a loop the plant is not what simulates best, for its input holds the noise: whitened from the first step on.
    """
    found = []
    for i, first in enumerate(starts):
        report(float(i), len(starts), f"fitting {first.n_blocks} modes")
        for _, model in _with_rigid_bodies(target, first, rigid_bodies):
            vector, _, layout = _vector(target, model, structure)
            own = replace(target, whitening=_whitened(target, vector, layout, noise_order))
            found.append(_fit(own, model, structure, noise_order, iterations))
    best = min(found, key=lambda fit: fit.criterion)
    return best, best.criterion


def _near(
    target: TimeTarget,
    starts: list[ModalModel],
    structure: Structure,
    rigid_bodies: int | None,
    iterations: int,
    compared: dict[bytes, Compared],
    report: Report,
) -> list[Compared]:
    """Return the best that any start leads to with white errors, of the best two numbers of rigid bodies allowed.

    Starts are compared as simulations, with white errors: a noise model that may explain anything would flatter a
    start that explains nothing. One that is already in `compared` is not followed again.
    """
    near: dict[int, Compared] = {}
    least = np.inf
    for i, first in enumerate(starts):
        report(0.5 * i, len(starts), f"fitting {first.n_blocks} modes")
        for rigid, model in _with_rigid_bodies(target, first, rigid_bodies):
            key = pack(model).tobytes()
            if key not in compared:
                fit = _fit(target, model, structure, 0, iterations, _COARSE, hopeless=_HOPELESS * least)
                compared[key] = Compared(fit.model, fit.criterion, _squared_error(target, fit))
            one = compared[key]
            least = min(least, one.squared_error)
            if rigid not in near or one.criterion < near[rigid].criterion:
                near[rigid] = one
    # a start that has a rigid body leads to the same with none more
    ranked = sorted({id(one): one for one in near.values()}.values(), key=lambda one: one.criterion)[:2]
    return [one for one in ranked if one is ranked[0] or one.squared_error <= _HOPELESS * least]


def _best_of(
    near: Sequence[Compared],
    target: TimeTarget,
    structure: Structure,
    noise_order: int | None,
    iterations: int,
    report: Report,
) -> tuple[TimeFit, float]:
    """Return the best of several fits once they are whitened, and the criterion of the first with white errors."""
    if noise_order == 0:
        exact = _fit(target, near[0].model, structure, noise_order, iterations)
        return exact, exact.criterion
    report(0.5, 1.0, f"fitting {near[0].model.n_blocks} modes")  # whitening takes about as long as all the starts
    whitened = [_fit(target, one.model, structure, noise_order, iterations) for one in near]
    return min(whitened, key=lambda fit: fit.criterion), near[0].criterion


def _squared_error(target: TimeTarget, fit: TimeFit) -> float:
    """Return the sum of squares of a fit's residual, whitened by the weights of `target`."""
    errors = [y - m for y, m in zip(target.outputs, fit.outputs, strict=True)]
    return float(sum(np.sum((e * target.whitening[:, 0]) ** 2) for e in errors))


def _with_rigid_bodies(target: TimeTarget, model: ModalModel, wanted: int | None) -> Iterator[tuple[int, ModalModel]]:
    """Yield (number of rigid bodies, model) with the poles of the lowest blocks at zero, as many as may be."""
    pole = np.min(np.abs(model.poles_1_s()), axis=1)
    order = np.argsort(pole)
    longest = max(u.shape[0] for u in target.inputs) / target.rate_hz
    # a pole that turns less than a few times in the longest record may be a rigid body's; the criterion decides
    slow = int(np.sum(pole < 20.0 * np.pi / longest))
    for count in range(slow + 1) if wanted is None else [min(wanted, model.n_blocks)]:
        omega, sigma = model.omega_rad_s.copy(), model.sigma_1_s.copy()
        omega[order[:count]] = sigma[order[:count]] = 0.0
        yield count, model.with_(omega_rad_s=omega, sigma_1_s=sigma)


def _target(inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float) -> TimeTarget:
    """Return the checked records with each output weighted by its own size."""
    if not inputs or len(inputs) != len(outputs):
        raise ConfigError(f"{len(inputs)} input and {len(outputs)} output records; give one of each per record")
    us, ys = (tuple(np.asarray(x, dtype=float) for x in records) for records in (inputs, outputs))
    for k, (u, y) in enumerate(zip(us, ys, strict=True)):
        if u.ndim != 2 or y.ndim != 2 or u.shape[0] != y.shape[0]:
            raise ConfigError(f"record {k}: input {u.shape} and output {y.shape}; needs (n, channels) with the same n")
        if not (np.all(np.isfinite(u)) and np.all(np.isfinite(y))):
            raise DataError(f"record {k} holds a number that is not finite; cut it out or repair it")
    size = np.sqrt(np.mean([y.var(axis=0) for y in ys], axis=0))
    if np.any(size == 0.0):
        raise DataError(f"output channel {int(np.argmin(size))} is constant; it cannot be identified")
    return TimeTarget(us, ys, float(rate_hz), 1.0 / size[:, None])


def _fit(
    target: TimeTarget,
    start: ModalModel,
    structure: Structure,
    noise_order: int | None,
    iterations: int,
    tolerance: float = 1e-8,
    *,
    hopeless: float = np.inf,
) -> TimeFit:
    """Return the fit from one start: weighted by the errors of `target` first, then whitened by the residual's.

    One that still leaves more than is `hopeless` after a few steps is returned as it is then.
    """
    vector, free, layout = _vector(target, start, structure)
    limit = np.concatenate([step_limit(layout), np.full(int(free[layout.size :].sum()), np.inf)])
    converged = False
    for _ in range(4):
        vector, converged, cost = _minimise(target, vector, free, limit, layout, iterations, tolerance, hopeless)
        given_up, hopeless = not converged and cost > hopeless, np.inf
        filters = _whitened(target, vector, layout, noise_order)
        settled = filters.shape == target.whitening.shape and np.allclose(
            filters, target.whitening, rtol=1e-3, atol=1e-3 * np.abs(filters).max()
        )
        target = replace(target, whitening=filters)
        if settled or given_up:
            break
    return _result(target, vector, free, structure, layout, converged)


def _vector(target: TimeTarget, start: ModalModel, structure: Structure) -> tuple[Array, Array, Layout]:
    """Return all parameters of a start, those of the records at rest, which of them are free, and their layout."""
    layout = layout_of(start, structure)
    vector = np.concatenate([pack(start), np.zeros(len(target.inputs) * (2 * layout.n_blocks + layout.n_outputs))])
    free = np.concatenate([layout.free, np.ones(vector.size - layout.size, dtype=bool)])
    for place, y in zip(nuisances(layout, len(target.inputs)), target.outputs, strict=True):
        free[place.offset[:1]] = structure.offset
        vector[place.offset] = y.mean(axis=0) if structure.offset else 0.0
    return vector, free, layout


def _whitened(target: TimeTarget, vector: Array, layout: Layout, noise_order: int | None) -> Array:
    errors = [m - y for m, y in zip(model_outputs(target, vector, layout), target.outputs, strict=True)]
    return whitening_filters(errors, noise_order)


def _minimise(
    target: TimeTarget,
    vector: Array,
    free: Array,
    limit: Array,
    layout: Layout,
    iterations: int,
    tolerance: float,
    hopeless: float,
) -> tuple[Array, bool, float]:
    """Return the whole parameter vector at the minimum over its free part, whether it was reached, and the cost."""

    def full(x: Array) -> Array:
        whole = vector.copy()
        whole[free] = x
        return whole

    def assemble(x: Array) -> Normal:
        normal = time_normal_equations(target, full(x), layout)
        return Normal(normal.cost, normal.gradient[free], normal.hessian[np.ix_(free, free)])

    def cost(x: Array) -> float:
        return whitened_cost(target, full(x), layout)

    minimum = minimise(assemble, cost, vector[free], iterations, tolerance, limit, hopeless)
    return full(minimum.parameters), minimum.converged, minimum.normal.cost


def _at_rest(model: ModalModel, target: TimeTarget) -> ModalModel:
    """Return the model without springs that do nothing in the longest record: no number of theirs is known."""
    longest = max(u.shape[0] for u in target.inputs) / target.rate_hz
    slowest = np.min(np.abs(model.poles_1_s()), axis=1)
    return model.with_(omega_rad_s=np.where(slowest * longest < _NOTHING, 0.0, model.omega_rad_s))


def _result(
    target: TimeTarget, vector: Array, free: Array, structure: Structure, layout: Layout, converged: bool
) -> TimeFit:
    """Return the result with the covariance of the canonical model."""
    places = nuisances(layout, len(target.inputs))
    outputs = tuple(model_outputs(target, vector, layout))
    model = canonical(_at_rest(unpack(vector[: layout.size], layout), target))
    # the canonical scaling changes the states' coordinates; states are estimated anew in them, linearly, by one step
    vector = np.concatenate([pack(model), vector[layout.size :]])
    normal = time_normal_equations(target, vector, layout)
    linear = np.concatenate([np.r_[place.state.ravel(), place.offset] for place in places])
    linear = linear[free[linear]]
    part = normal.hessian[np.ix_(linear, linear)]
    vector[linear] -= np.linalg.lstsq(part, normal.gradient[linear], rcond=1e-13)[0]
    normal = time_normal_equations(target, vector, layout)
    index = np.flatnonzero(np.concatenate([determined(model, layout), free[layout.size :]]))
    inside = np.ix_(index, index)
    small = covariance(Normal(normal.cost, normal.gradient[index], normal.hessian[inside]))
    count = index.size
    whole = np.zeros((vector.size, vector.size))
    whole[inside] = small
    cov = whole[: layout.size, : layout.size]
    std = np.sqrt(np.maximum(np.diag(cov), 0.0))
    logs = -2.0 * sum(y.shape[0] for y in target.outputs) * float(np.sum(np.log(target.whitening[:, 0])))
    taps = int(np.count_nonzero(target.whitening[:, 1:]))
    criterion = normal.cost + logs + (count + taps) * np.log(target.values)
    return TimeFit(
        model,
        structure,
        layout,
        cov,
        model.omega_rad_s * std[layout.index("log_omega")],
        model.sigma_1_s * std[layout.index("log_sigma")],
        outputs,
        tuple(vector[place.state] for place in places),
        tuple(vector[place.offset] for place in places),
        1.0 / target.whitening[:, 0],
        target.whitening,
        normal.cost,
        max(target.values - count, 1),
        float(criterion),
        converged,
        ((model.n_blocks, float(criterion)),),
    )
