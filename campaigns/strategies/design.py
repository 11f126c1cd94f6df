"""What control design may know of a bench: a design model, never the model that a simulated bench runs.

Feed-forward and learning are designed on it axis by axis; the feedback is the one that the paper tuned.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, TypeVar

import numpy as np

from campaigns.strategies.controller import Controller, load_controller
from sim_backend.assembly import places_of, retuned
from sim_backend.bench import Learning
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.control.feedback import LoopShape, closed_loop_poles, z_controller
from sim_backend.control.feedforward import StepInput, least_norm
from sim_backend.control.repetitive import TABLE_6_5, learning_filter
from sim_backend.effects import Site, effect_class, make_effect
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise
from sim_backend.model import Model, load_model, number

T = TypeVar("T")

MOST_KEPT = 64
"""Results that one design keeps: the axes, moves and loops of a campaign are a tenth of that."""


@lru_cache(maxsize=MOST_KEPT)
def feedback_of(dof: str, rate_hz: float, factor: float = 1.0) -> DiscreteFilter:
    """Return the paper's feedback of an axis times `factor`; raises ConfigError for an axis that it does not treat.

    The same values give the same object, so nothing may change it.
    """
    if dof.startswith("theta"):
        return LoopShape(rate_hz=rate_hz).filter().scaled(factor)
    if dof == "z":
        return z_controller(rate_hz).scaled(factor)
    raise ConfigError(f"no feedback is known for axis '{dof}'; strategies treat theta_x, theta_y and z")


@dataclass(frozen=True)
class Design:
    """A design model at the sample rate of the bench that it is for, and the controller designed on it, if any.

    Its results are kept, for most runs of a campaign ask for the same: nothing may change them.
    """

    model: Model
    rate_hz: float
    controller: Controller | None = None
    _kept: dict[tuple[object, ...], Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def load(cls, name_or_path: str, rate_hz: float) -> Design:
        """Return the design on a bundled model or a file; raises ConfigError when there is none."""
        model = load_model(name_or_path)
        for design in tuple(_LOADED):
            if design.model is model and design.rate_hz == rate_hz:
                return design
        design = cls(model, rate_hz)
        _LOADED.append(design)
        return design

    @classmethod
    def controlled(cls, path: str, rate_hz: float) -> Design:
        """Return the design in a controller file; raises ConfigError as its loader, and for another sample rate."""
        controller = load_controller(path)
        if controller.sample_rate_hz != rate_hz:
            raise ConfigError(
                f"{path} is for {controller.sample_rate_hz:g} Hz, the bench runs at {rate_hz:g} Hz; design it for that"
            )
        return cls(controller.model, rate_hz, controller)

    @cached_property
    def _whole(self) -> ModalModel:
        """The linear part of the model with those of its effects that act on it, as a diagnosis adds them."""
        acting = [
            make_effect(e.effect, e.where, {name: number(value) for name, value in e.parameters.items()})
            for e in self.model.effects
            if effect_class(e.effect).site is Site.MODEL
        ]
        return retuned(self.model.linear(), acting, places_of(self.model))

    def _once(self, key: tuple[object, ...], make: Callable[[], T]) -> T:
        """Return what `make` has returned under this key, called now if it has not been."""
        kept: T | None = self._kept.get(key)
        if kept is None:
            kept = make()
            if len(self._kept) >= MOST_KEPT:
                self._kept.clear()
            self._kept[key] = kept
        return kept

    def axis(self, dof: str) -> ModalModel:
        """Return the modes from the input to the output of one degree of freedom, one input, one output.

        Raises ConfigError when the model lacks it.
        """
        return self._once(("axis", dof), lambda: self._axis(dof))

    def _axis(self, dof: str) -> ModalModel:
        model = self.model
        ins, outs = [p.dof for p in model.inputs], [p.dof for p in model.outputs]
        if dof not in ins or dof not in outs:
            raise ConfigError(
                f"design model '{model.name}' has no input and output '{dof}'; "
                f"it has {', '.join(ins)} → {', '.join(outs)}: give a model of this axis"
            )
        whole, i, o = self._whole, ins.index(dof), outs.index(dof)
        acts = (np.abs(whole.b[:, i]) + np.abs(whole.b_direct[:, i])) * (
            np.abs(whole.c[o]) + np.abs(whole.c_rate[o])
        ) > 0.0
        return ModalModel(
            omega_rad_s=whole.omega_rad_s[acts],
            sigma_1_s=whole.sigma_1_s[acts],
            b=whole.b[acts][:, [i]],
            b_direct=whole.b_direct[acts][:, [i]],
            c=whole.c[[o]][:, acts],
            c_rate=whole.c_rate[[o]][:, acts],
            d=whole.d[[o]][:, [i]],
            delay_s=whole.delay_s[[i]],
        )

    def require_stable(self, dof: str, controller: DiscreteFilter) -> None:
        """Raise ConfigError when the loop of `controller` around this axis of the design model is unstable.

        An axis that the model does not have cannot be judged. Delays are rounded up to whole samples.
        """
        if dof not in {p.dof for p in self.model.inputs} & {p.dof for p in self.model.outputs}:
            return
        # kept with the controller itself: while it lives, no other has its id
        largest, _ = self._once(
            ("loop", dof, id(controller)), lambda: (self._largest_pole(dof, controller), controller)
        )
        if not largest < 1.0:
            raise ConfigError(
                f"controller of {dof}: its loop around design model '{self.model.name}' is unstable, the largest "
                f"closed-loop pole is {largest:.4f} from zero, the limit is 1; lower the gain (tuning.feedback_factor)"
            )

    def _largest_pole(self, dof: str, controller: DiscreteFilter) -> float:
        plant = self.axis(dof)
        whole = np.ceil(plant.delay_s * self.rate_hz - 1e-9) / self.rate_hz
        poles = closed_loop_poles(discretise(plant.with_(delay_s=whole), self.rate_hz), controller)
        return float(np.max(np.abs(poles)))

    def unit_step(self, dof: str, n_samples: int) -> StepInput:
        """Return the least-norm input for a move of 1 in `n_samples`; raises ConfigError as `least_norm`."""
        return self._once(("step", dof, n_samples), lambda: least_norm(self.axis(dof), [1.0], n_samples, self.rate_hz))

    def learning(self, dof: str, period: int, n_modes: int, active: bool = True) -> Learning:
        """Return repetitive control of an axis as Table 6.5 tunes it, its L inverting the `n_modes` strongest modes.

        Strongest at rest, by static participation. Raises ConfigError for an axis that the table does not have.
        """
        if dof not in TABLE_6_5:
            raise ConfigError(f"no learning is tuned for axis '{dof}'; Table 6.5 has {', '.join(TABLE_6_5)}")
        tuning, model = TABLE_6_5[dof], self.axis(dof)
        static = (model.c[0] * model.b[:, 0]) / model.omega_rad_s**2
        chosen = np.argsort(-np.abs(static), kind="stable")[:n_modes]
        learned = learning_filter(
            model.omega_rad_s[chosen],
            model.sigma_1_s[chosen],
            float(static.sum() + model.d[0, 0]),
            tuning.cutoff_hz,
            self.rate_hz,
        )
        return Learning(learned, tuning.gain, tuning.lead_samples, period, active=active)


_LOADED: deque[Design] = deque(maxlen=8)
"""The designs last loaded, of as many models as `parse_model` keeps: the same text is the same object there."""
