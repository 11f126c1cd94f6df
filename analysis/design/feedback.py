"""The feedback of an axis: least variance against the measured noise, among those that leave enough margin."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from analysis.design.uncertainty import MOST, static_response
from analysis.recorded.requirements import STABILITY_RAD
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.control.feedback import Margins, closed_loop_poles, loop_margins
from sim_backend.control.lqg import LinearQuadraticGaussian, Noise, least_reading_rad, reading_spectrum
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

PEAK_DB = 6.0
"""Largest peak of |S| on the identified plant: the usual limit of 2, a gain margin of 6 dB and a phase margin of 29°
(Åström and Murray, Feedback Systems, 2008, section 12.3)."""

WORST_PEAK_DB = 8.0
"""Largest peak of |S| on MOST plants within the uncertainty: they come no nearer to instability than 0.4."""

SLIGHT = 0.01
"""A mode with less of the static gain than this may be left out of the model that the estimator knows: it then keeps
away from it, where knowing it precisely would only help on the identified plant."""

QUIET = 0.5
"""Part of the required stability that the noise may take on the worst plant: another bench is up to twice as loud."""

MEASURED = 1.06
"""Stability that is measured over the predicted one: the largest of two axes and two positions, each known to 2 %
from a few seconds, with what learning leaves beside the noise. Calibrated: it was 1.05 in the middle of 300 drawn
benches, 1.10 in 5 % of them (2026-11-28)."""

SOME = 8
"""Of dozens of quiet feedbacks, so many are worth a closer look."""

EFFORTS_RAD_NM = tuple(float(e) for e in np.geomspace(1e-4, 1e-2, 25))
"""From the fastest regulator that amplifiers could follow to one so slow that lightly damped modes stay as they are,
where the Riccati equations begin to lose their solution to rounding."""

DISTRUSTS = (0.0, 3.0, 5.5, 10.0, 17.0, 30.0)

HALVINGS = 2
"""How often the steps between the weights are halved where none of the grid is quiet: an effort to 5 %."""


AROUND = tuple(one for one in product((-1, 0, 1), repeat=2) if any(one))
"""Directions of a search in effort and distrust."""


@dataclass(frozen=True)
class FeedbackDesign:
    """The chosen feedback of one axis.

    `margins` are those of the identified plant; `peak_db` (n,) the peaks of |S| and `three_sigma_rad` (n,) the
    stability predicted for every drawn plant, the identified one first. `from_torque_rad` and `from_reading_rad` are
    the 3σ shares of both noises, `least_rad` the 3σ below which no linear feedback can bring the identified plant.
    """

    controller: DiscreteFilter
    effort_rad_nm: float
    distrust: float
    margins: Margins
    peak_db: Array
    three_sigma_rad: Array
    from_torque_rad: float
    from_reading_rad: float
    least_rad: float

    @property
    def quiet(self) -> float:
        """The part of benches whose stability is met, with noise of half to twice that measured (uniform in log)."""
        louder = np.log2(STABILITY_RAD / (MEASURED * self.three_sigma_rad))
        return float(np.mean(np.clip(0.5 * (1.0 + louder), 0.0, 1.0)))


def frequency_grid(plant: ModalModel, rate_hz: float) -> Array:
    """Return frequencies (n,) up to half the rate that resolve every mode of a plant."""
    f = [np.geomspace(0.02, 0.5 * rate_hz, 1500)]
    for omega, sigma in zip(plant.omega_rad_s, plant.sigma_1_s, strict=True):
        centre, width = omega / (2.0 * np.pi), max(float(sigma), 0.5) / (2.0 * np.pi)
        f.append(centre + width * np.sinh(np.linspace(-6.0, 6.0, 241)))
    whole = np.unique(np.concatenate(f))
    return np.asarray(whole[(whole > 0.0) & (whole <= 0.5 * rate_hz)])


def design_feedback(plants: list[ModalModel], noise: Noise, rate_hz: float) -> FeedbackDesign:
    """Return the first of `safe_feedbacks`: of least predicted 3σ on the worst of `plants`; raises as they."""
    return next(safe_feedbacks(plants, noise, rate_hz))


def safe_feedbacks(plants: list[ModalModel], noise: Noise, rate_hz: float) -> Iterator[FeedbackDesign]:
    """Yield the feedbacks whose |S| keeps its limits on all `plants`, the first of them identified.

    First SOME of those that are quiet even with twice the noise, from the quietest to the one of most margin; then the
    others. Raises ConfigError when no feedback keeps every plant stable within that.
    """
    f = frequency_grid(plants[0], rate_hz)
    responses = np.stack([discretise(p, rate_hz).frequency_response(f)[:, 0, 0] for p in plants])
    solved: list[_Candidate] = []
    for plant in _known(plants[0], rate_hz):
        known = LinearQuadraticGaussian(plant, noise, rate_hz)

        def tried(effort: float, distrust: float, known: LinearQuadraticGaussian = known) -> _Candidate | None:
            return _candidate(f, responses, known, noise, effort, distrust, rate_hz)

        some = [one for e, d in product(EFFORTS_RAD_NM, DISTRUSTS) if (one := tried(e, d)) is not None]
        solved += [*some, *_refined(some, tried)]
    if not solved:
        raise ConfigError(
            "feedback: no Riccati equation of this plant and noise can be solved in double precision; compare gains "
            "and units of the model with those of the bench (`mccd log show`), and identify the axis anew"
        )
    least = 3.0 * least_reading_rad(plants[0], noise, rate_hz)
    safe = [one for one in solved if one.peak_db[0] <= PEAK_DB and one.most_peak_db <= WORST_PEAK_DB]
    found = False
    by_noise = sorted(safe, key=lambda one: float(one.three_sigma_rad.max()))
    quiet = [one for one in by_noise if one.three_sigma_rad.max() <= QUIET * STABILITY_RAD]
    for one in (*quiet[:: -(-len(quiet) // SOME) or 1], *by_noise[len(quiet) :]):
        if all(largest_pole(plant, one.controller, rate_hz) < 1.0 for plant in plants):
            found = True
            yield _described(f, responses[0], plants[0], one, noise, least, rate_hz)
    if found:
        return
    lowest = min((one.most_peak_db, float(one.peak_db[0])) for one in solved)
    raise ConfigError(
        f"feedback: on 95 % of the plants within the uncertainty |S| peaks at {lowest[0]:.2f} dB at best and then at "
        f"{lowest[1]:.2f} dB on the identified one, the limits are {WORST_PEAK_DB:g} and {PEAK_DB:g} dB with every "
        "plant stable; identify the axis better or state a smaller tolerance"
    )


def _known(plant: ModalModel, rate_hz: float) -> list[ModalModel]:
    """Return the models that an estimator may know: the plant, and its strong modes alone a sample later."""
    share = np.abs(static_response(plant))
    strong = plant.only(share >= SLIGHT * share.max())
    return [plant, strong.with_(delay_s=strong.delay_s + 1.0 / rate_hz)]


def _refined(some: Sequence[_Candidate], tried: Callable[[float, float], _Candidate | None]) -> Iterator[_Candidate]:
    """Yield better weights between those of a grid, where none of it is quiet: a pattern search from half its steps on.

    The best weights lie where a limit of |S| begins, along which both change, so both are moved at once as well.

    Source: T. G. Kolda, R. M. Lewis and V. Torczon, SIAM Review 45 (2003), 385, section 1.1.
    """
    best = min(some, key=_Candidate.rank, default=None)
    if best is None or best.rank() <= (0.0, QUIET * STABILITY_RAD):
        return
    # a step of the grid is about half in the logarithm of one plus the distrust
    step = 0.5 * np.array([np.log(EFFORTS_RAD_NM[1] / EFFORTS_RAD_NM[0]), 0.5])
    for _ in range(HALVINGS):
        moved = True
        while moved:
            moved = False
            for towards in AROUND:
                change = step * towards
                effort = float(best.effort_rad_nm * np.exp(change[0]))
                distrust = float(np.expm1(np.log1p(best.distrust) + change[1]))
                if not EFFORTS_RAD_NM[0] <= effort <= EFFORTS_RAD_NM[-1] or not 0.0 <= distrust <= DISTRUSTS[-1]:
                    continue
                one = tried(effort, distrust)
                if one is not None and one.rank() < best.rank():
                    best, moved = one, True
                    yield one
        step = 0.5 * step


@dataclass(frozen=True)
class _Candidate:
    """A feedback and what it does on every plant."""

    controller: DiscreteFilter
    effort_rad_nm: float
    distrust: float
    peak_db: Array
    three_sigma_rad: Array

    def rank(self) -> tuple[float, float]:
        """Return what is to be least: by how much |S| breaks its limits in dB, then the 3σ on the worst plant."""
        broken = max(float(self.peak_db[0]) - PEAK_DB, self.most_peak_db - WORST_PEAK_DB, 0.0)
        return broken, float(self.three_sigma_rad.max())

    @property
    def most_peak_db(self) -> float:
        """The peak of |S| in dB that MOST of the plants keep."""
        return float(np.quantile(self.peak_db, MOST))


def _candidate(
    f: Array,
    responses: ComplexArray,
    known: LinearQuadraticGaussian,
    noise: Noise,
    effort: float,
    distrust: float,
    rate_hz: float,
) -> _Candidate | None:
    """One pair of weights; None where the equations have no solution, as rounding finds with weights far apart."""
    try:
        made = known.controller(effort, distrust)
    except ConfigError:
        return None
    response = made.frequency_response(f)
    peak_db = 20.0 * np.log10(np.max(1.0 / np.abs(1.0 + responses * response), axis=1))
    return _Candidate(made, effort, distrust, peak_db, three_sigma(f, responses, response, noise, rate_hz))


def _described(
    f: Array,
    plant_response: ComplexArray,
    plant: ModalModel,
    chosen: _Candidate,
    noise: Noise,
    least: float,
    rate_hz: float,
) -> FeedbackDesign:
    made, sampled = chosen.controller, discretise(plant, rate_hz)
    spectra = reading_spectrum(f, plant_response, made.frequency_response(f), noise, rate_hz)

    def loop(at: Array) -> ComplexArray:
        return np.asarray(sampled.frequency_response(at)[:, 0, 0] * made.frequency_response(at))

    torque, reading = (float(3.0 * np.sqrt(_mean(f, s))) for s in spectra)
    return FeedbackDesign(
        controller=made,
        effort_rad_nm=chosen.effort_rad_nm,
        distrust=chosen.distrust,
        margins=loop_margins(loop, 0.5, 0.499 * rate_hz),
        peak_db=chosen.peak_db,
        three_sigma_rad=chosen.three_sigma_rad,
        from_torque_rad=torque,
        from_reading_rad=reading,
        least_rad=least,
    )


def three_sigma(f: Array, plants: ComplexArray, controller: ComplexArray, noise: Noise, rate_hz: float) -> Array:
    """Return 3σ of the reading (n,) in closed loop for the responses `plants` (n, n_f) of one controller (n_f,)."""
    torque, reading = reading_spectrum(f, plants, controller, noise, rate_hz)
    return np.asarray(3.0 * np.sqrt(_mean(f, torque + reading)))


def largest_pole(plant: ModalModel, controller: DiscreteFilter, rate_hz: float) -> float:
    """Return the distance from zero of the outermost closed-loop pole in z; delays are rounded up to whole samples."""
    whole = np.ceil(plant.delay_s * rate_hz - 1e-9) / rate_hz
    return float(np.max(np.abs(closed_loop_poles(discretise(plant.with_(delay_s=whole), rate_hz), controller))))


def _mean(f: Array, spectrum: Array) -> Array:
    """Return the mean (...) of powers (..., n_f) over all frequencies up to the last, from an uneven grid."""
    return np.asarray(np.trapezoid(spectrum, f) / f[-1])
