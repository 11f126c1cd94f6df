"""Identification of a sum of second-order blocks from frequency responses, of given or of chosen order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.identification.modal_parameters import Structure
from analysis.identification.response_fit import RationalFit, Target, make_target, refine, residual_cost
from analysis.identification.response_start import starting_models, with_new_block, without_weakest_block
from campaigns.progress import Report, unheard
from sim_backend.errors import ConfigError
from sim_backend.linear import Array, ModalModel

ComplexArray = NDArray[np.complex128]


def fit_rational(
    frequency_hz: Array,
    response: ComplexArray,
    blocks: int | tuple[int, ...],
    *,
    variance: Array | None = None,
    hold_rate_hz: float | None = None,
    structure: Structure | None = None,
    rigid_bodies: int | None = 0,
    start: ModalModel | None = None,
    iterations: int = 200,
    report: Report = unheard,
) -> RationalFit:
    """Return the ModalModel that fits a complex frequency response best.

    Shapes: `frequency_hz` (n_f,), rising; `response` (n_f, n_y, n_u); `variance` (n_f, n_y, n_u), E|error|² of each
    entry, or None for equal weights. `blocks` is the number of second-order blocks, or several to choose from by the
    Bayesian information criterion. `hold_rate_hz` is the rate of the zero-order hold before the plant, None for a
    band-limited measurement. `rigid_bodies` blocks get their poles at zero; None lets the criterion decide.
    `start`, a nominal model with no more blocks than wanted, replaces vector fitting. Raises ConfigError or
    DataError when the arguments do not fit together.
    """
    target = make_target(frequency_hz, response, variance, hold_rate_hz)
    wanted = (blocks,) if isinstance(blocks, int) else tuple(sorted(blocks))
    require_blocks(wanted)
    lines = target.frequency_hz.size
    if 2 * wanted[-1] >= lines:
        raise ConfigError(
            f"{wanted[-1]} modes (blocks) need more than {2 * wanted[-1]} frequency bins, and there are {lines}; "
            f"choose 1 to {(lines - 1) // 2} (--modes)"
        )
    if start is not None and (start.d.shape != target.response.shape[1:] or start.n_blocks > wanted[0]):
        shape = f"{start.n_blocks} blocks, {start.n_outputs} outputs and {start.n_inputs} inputs"
        raise ConfigError(f"start has {shape}; needs at most {wanted[0]} blocks and the response's outputs and inputs")
    search = _Search(target, structure or Structure(), variance is None, iterations, start)
    best: RationalFit | None = None
    fit: RationalFit | None = None
    tried: list[tuple[int, float]] = []
    for i, count in enumerate(wanted):
        report(sum(wanted[:i]), sum(wanted), f"fitting {count} modes")
        fit = search.best_of_order(count, fit)
        fit = search.with_rigid_bodies(fit, rigid_bodies)
        tried.append((count, fit.criterion))
        best = fit if best is None or fit.criterion < best.criterion else best
    assert best is not None
    return replace(best, orders=tuple(tried))


def require_blocks(wanted: Sequence[int]) -> None:
    """Raise ConfigError unless the numbers of modes to choose from, the smallest first, are there and above zero."""
    if not wanted or wanted[0] < 1:
        given = f"{wanted[0]} modes (blocks) are asked for" if wanted else "no number of modes (blocks) is given"
        raise ConfigError(f"{given}; give 1 or more (--modes)")


class _Search:
    """Local fits from several starts of one order, under one target and one structure."""

    def __init__(
        self, target: Target, structure: Structure, scaled: bool, iterations: int, nominal: ModalModel | None
    ) -> None:
        self._target, self._structure = target, structure
        self._scaled, self._iterations, self._nominal = scaled, iterations, nominal

    def _fit(self, start: ModalModel, iterations: int) -> RationalFit:
        return refine(self._target, start, self._structure, self._scaled, iterations)

    def best_of_order(self, count: int, smaller: RationalFit | None) -> RationalFit:
        """Return the best fit with `count` blocks, from vector fitting, from a smaller fit, and from exchanges.

        An exchange adds a block where the residual is largest and takes out the one that is missed least; it leads
        out of minima in which a block stands where there is no mode. It is repeated while it helps.
        """
        short = max(self._iterations // 5, 10)
        starts = list(self._starts(count, smaller))
        each = short if len(starts) == 1 else short // 2
        best = min((self._fit(start, each) for start in starts), key=lambda fit: fit.chi2)
        while not self._adequate(best):
            grown = self._fit(with_new_block(self._target, best.model, self._structure), short // 2)
            trial = self._fit(without_weakest_block(self._target, grown.model), short)
            if trial.chi2 > (1.0 - 1e-3) * best.chi2:
                break
            best = trial
        return best if best.converged else self._fit(best.model, self._iterations)

    def _starts(self, count: int, smaller: RationalFit | None) -> Iterator[ModalModel]:
        if self._nominal is None:
            yield from starting_models(self._target, count, self._structure)
        for model in [self._nominal] if smaller is None else [smaller.model]:
            if model is None:
                continue
            while model.n_blocks < count:
                model = with_new_block(self._target, model, self._structure)
            yield model

    def _adequate(self, fit: RationalFit) -> bool:
        """Return whether the noise explains the residual: chi2 within three standard deviations of dof."""
        return not fit.scaled and fit.chi2 < fit.dof + 3.0 * np.sqrt(2.0 * fit.dof)

    def with_rigid_bodies(self, fit: RationalFit, wanted: int | None) -> RationalFit:
        """Return the fit with poles at zero for the lowest `wanted` blocks, or for as many as the criterion likes."""
        below = 2.0 * np.pi * self._target.frequency_hz[0]
        for i in range(fit.model.n_blocks if wanted is None else min(wanted, fit.model.n_blocks)):
            pole = np.min(np.abs(fit.model.poles_1_s()), axis=1)
            order = np.argsort(pole)
            omega, sigma = fit.model.omega_rad_s.copy(), fit.model.sigma_1_s.copy()
            if wanted is None and pole[order[i]] > below:
                break
            omega[order[i]] = sigma[order[i]] = 0.0
            start = fit.model.with_(omega_rad_s=omega, sigma_1_s=sigma)
            if not np.isfinite(residual_cost(self._target, start)):
                raise ConfigError("a rigid body has no finite response at 0 Hz; leave that line out")
            trial = self._fit(start, self._iterations)
            if wanted is None and trial.criterion > fit.criterion:
                break
            fit = trial
        return fit
