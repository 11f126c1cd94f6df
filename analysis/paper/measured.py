"""What a campaign's folder of logs has measured, each measurement made once and only when it is asked for."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import numpy as np

from analysis.identification.modal_parameters import Structure
from analysis.identification.rational import fit_rational
from analysis.identification.response_fit import RationalFit
from analysis.measurements.loop_fit import LoopFit
from analysis.measurements.loops import Loop
from analysis.paper.broad_mode import broad_mode
from analysis.paper.nonlinear_model import simulated_steps
from analysis.recorded.chop import ChopPhase, chop_phase
from analysis.recorded.drift import DriftTest, drift_of
from analysis.recorded.hysteresis import OffsetStep, loops_of, steps_of
from analysis.recorded.loop_fit import loop_fit_of
from analysis.recorded.sensors import EndstopTest, TheodoliteTest, endstops_of, theodolite_of
from analysis.recorded.sweep import Sweep, sweep_of
from campaigns.log import Run, read_run
from campaigns.strategies.design import Design
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import ModalModel

T = TypeVar("T")

MODES = {"theta_x": 4, "theta_y": 2, "z": 1}
"""How many modes the paper gives each axis: 8th, 4th and 2nd order."""

PAIR_HZ = {"theta_x": (1400.0, 1500.0)}
"""Where Table 6.1 and the text have two resonances, for which one broad mode of the paper's model stands."""

RATE_HZ = 10_000.0
"""The bench's sample rate, at which the paper's controllers are designed."""

WARM_K, COLD_K = 77.0, 63.5
"""Temperatures of the two sweeps of section 6.4.3."""

RELATIVE_FLOOR = 0.005
"""How far hysteresis moves a response with amplitude, about: higher weights would fit it, not the modes."""


@dataclass(frozen=True)
class _Entry:
    run: Run
    settings: dict[str, Any]


class Measured:
    """The measurements of all complete runs in folders; each method returns None where the campaigns lack the run.

    While a `tracing` block is open, the unique names of the runs that are asked for are collected. Use it as a context
    manager: it keeps the logs open. Raises DataError for a log that is none, ConfigError for a folder without logs.
    """

    def __init__(self, folder: str | Path, *more: str | Path, design: str = "design") -> None:
        self.folder = Path(folder)
        self.design = Design.load(design, RATE_HZ)
        self._entries: list[_Entry] = []
        self._done: dict[tuple[object, ...], tuple[Any, tuple[str, ...]]] = {}
        self._traced: list[set[str]] = []
        for place in (self.folder, *more):
            self.add(place)
        if not self._entries:
            raise ConfigError(f"{self.folder} holds no complete log; run `mccd campaign run` into it first")

    def add(self, folder: str | Path) -> None:
        """Open the complete runs of another folder too; before anything is measured of what they could replace."""
        for path in sorted(Path(folder).glob("*.h5")):
            run = read_run(path)
            if run.status == "complete":
                self._entries.append(_Entry(run, run.header.settings))
            else:
                run.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for entry in self._entries:
            entry.run.close()

    @property
    def runs(self) -> tuple[Run, ...]:
        """Every complete run, in the order of their file names."""
        return tuple(entry.run for entry in self._entries)

    @contextlib.contextmanager
    def tracing(self) -> Iterator[set[str]]:
        """Collect the run_uids that are asked for inside the block."""
        uids: set[str] = set()
        self._traced.append(uids)
        try:
            yield uids
        finally:
            self._traced.remove(uids)

    def find(self, test: str, **settings: object) -> Run | None:
        """Return the first run of a test whose settings have these values (within rounding); None if there is none."""
        for entry in self._entries:
            if entry.run.header.test == test and all(_same(entry.settings.get(k), v) for k, v in settings.items()):
                return entry.run
        return None

    def settings(self, test: str) -> list[dict[str, Any]]:
        """Return the settings of every run of a test, in the order of their file names."""
        return [entry.settings for entry in self._entries if entry.run.header.test == test]

    def _once(self, key: tuple[object, ...], run: Run | None, measure: Callable[[Run], T]) -> T | None:
        """Measure a run once; whoever asks is told to rest on it."""
        if run is None:
            return None
        if key not in self._done:
            self._done[key] = (_of(run, measure), (run.run_uid,))
        value, uids = self._done[key]
        for traced in self._traced:
            traced.update(uids)
        result: T = value
        return result

    def sweep(self, axis: str, cold_finger_k: float | None = None) -> Sweep | None:
        """Return the sweep of an axis: the whole one, or the one at a set temperature."""
        run = self.find("sinesweep", axis=axis, cold_finger_k=cold_finger_k)
        return self._once(("sweep", axis, cold_finger_k), run, sweep_of)

    def temperatures(self, axis: str) -> tuple[Sweep, Sweep] | None:
        """Return the sweeps of an axis at 77 K and at 63.5 K, over the same frequencies; Fig. 6.17."""
        warm, cold = self.sweep(axis, WARM_K), self.sweep(axis, COLD_K)
        if warm is None or cold is None or not np.array_equal(warm.frequency_hz, cold.frequency_hz):
            return None
        return warm, cold

    def fit(self, axis: str) -> RationalFit | None:
        """Return the modal fit to the whole sweep of an axis, with the bench's zero-order hold and a delay.

        Without the delay a mode would absorb its phase. The fit has as many modes as the paper's model, or one more
        where the sweep shows a pair (`PAIR_HZ`). None without a sweep that covers every mode of the design model.
        """
        sweep = self.sweep(axis)
        modes_hz = self.design_axis(axis).omega_rad_s / (2.0 * np.pi)
        if sweep is None or not sweep.frequency_hz[0] < modes_hz.min() <= modes_hz.max() < sweep.frequency_hz[-1]:
            return None

        def of_order(run: Run, modes: int) -> RationalFit:
            variance = sweep.variance + 2.0 * (RELATIVE_FLOOR * np.abs(sweep.response)) ** 2
            return fit_rational(
                sweep.frequency_hz,
                sweep.response[:, None, None],
                modes,
                variance=variance[:, None, None],
                hold_rate_hz=run.sample_rate_hz,
                structure=Structure("mechanical", feedthrough=False, delay=True),
            )

        def fitted(run: Run) -> RationalFit:
            fit = of_order(run, MODES[axis])
            if axis not in PAIR_HZ:
                return fit
            finer = of_order(run, MODES[axis] + 1)
            low, high = PAIR_HZ[axis]
            # a mode more also describes how hysteresis changes the lowest one: only the pair is searched for
            hz = finer.model.omega_rad_s / (2.0 * np.pi)
            pair = np.sum((hz > low) & (hz < high)) == 2
            return finer if pair and finer.criterion < fit.criterion else fit

        return self._once(("fit", axis), self.find("sinesweep", axis=axis, cold_finger_k=None), fitted)

    def paper_model(self, axis: str) -> ModalModel | None:
        """Return the fit in the paper's order, without its delay, one broad mode for the pair of Table 6.1; Table 6.2.

        None also where a mode more than the paper's is not such a pair.
        """
        fit = self.fit(axis)
        if fit is None:
            return None
        prompt = fit.model.with_(delay_s=np.zeros(1))
        return prompt if prompt.n_blocks == MODES[axis] else broad_mode(prompt)

    def endstops(self) -> EndstopTest | None:
        """Return the noise against the end stops."""
        return self._once(("endstops",), self.find("endstops"), endstops_of)

    def theodolite(self) -> TheodoliteTest | None:
        """Return the gains against the theodolite."""
        return self._once(("theodolite",), self.find("theodolite"), theodolite_of)

    def loops(self, axis: str = "theta_x") -> dict[float, Loop] | None:
        """Return the hysteresis loops by torque amplitude, the design model's lag taken out."""
        lag_s = self.static_lag_s(axis)
        return self._once(("loops", axis), self.find("hysteresis", axis=axis), lambda run: loops_of(run, lag_s))

    def loop_fit(self, axis: str = "theta_x") -> LoopFit | None:
        """Return the nonlinear model fitted to the hysteresis loops, Table 6.3; None without such a run."""
        return self._once(("loop fit", axis), self.find("hysteresis", axis=axis), loop_fit_of)

    def steps(self, axis: str = "theta_x") -> list[OffsetStep] | None:
        """Return the mean step responses to feed-forward from each offset, Fig. 6.9; None without such a run."""
        return self._once(("steps", axis), self.find("hysteresis", axis=axis), steps_of)

    def model_steps(self, axis: str = "theta_x") -> list[OffsetStep] | None:
        """Return the same steps as the model fitted to the loops takes them."""
        fit = self.loop_fit(axis)
        if fit is None:
            return None
        run = self.find("hysteresis", axis=axis)
        return self._once(("model steps", axis), run, lambda found: simulated_steps(found, fit.parameters))

    def chop(self, alpha_deg: float, from_rad: float, to_rad: float, strategy: str = "hybrid") -> ChopPhase | None:
        """Return a slow chop under a strategy."""
        run = self.find("chop", alpha_deg=alpha_deg, from_rad=from_rad, to_rad=to_rad, strategy=strategy)
        return self._once(("chop", alpha_deg, from_rad, to_rad, strategy), run, chop_phase)

    def settle(self, strategy: str, alpha_deg: float, phase: str = "chop") -> ChopPhase | None:
        """Return a phase of a fast chop under a strategy; `alpha_deg` 0 is θx, 90 is θy."""
        run = self.find("settling", strategy=strategy, alpha_deg=alpha_deg)
        return self._once(("settle", strategy, alpha_deg, phase), run, lambda found: chop_phase(found, phase))

    def drift(self, strategy: str = "hybrid") -> DriftTest | None:
        """Return the drift over the long chop under a strategy."""
        return self._once(("drift", strategy), self.find("thermal", strategy=strategy), drift_of)

    def design_axis(self, axis: str) -> ModalModel:
        """Return the design model from one axis's input to its output."""
        return self.design.axis(axis)

    def suspension_period_s(self, axis: str) -> float:
        """Return the period of the design model's lowest mode."""
        return float(2.0 * np.pi / self.design_axis(axis).omega_rad_s.min())

    def static_lag_s(self, axis: str) -> float:
        """Return the design model's lag at low frequency, -d(phase)/d(omega) at 0, in s."""
        model = self.design_axis(axis)
        f = 1e-3
        return float(-np.angle(model.frequency_response(np.array([f]))[0, 0, 0]) / (2.0 * np.pi * f))


def _of(run: Run, measure: Callable[[Run], T]) -> T:
    """Measure a run; an error about its data says which file they are in."""
    try:
        return measure(run)
    except DataError as error:
        named = str(run.path) in str(error)
        raise DataError(str(error) if named else f"{run.path}: {error}") from None


def _same(found: object, wanted: object) -> bool:
    if isinstance(found, int | float) and isinstance(wanted, int | float):
        return abs(float(found) - float(wanted)) <= 1e-9 * max(1.0, abs(float(wanted)))
    return found == wanted
