"""Linear models as other packages have them: python-control and scipy.signal, there and back.

A ModalModel holds second-order blocks; what comes back has the same poles and the same response, in coordinates of its
own. Units are those of the model's ports: the other packages know none.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.linear.modal_form import modal_from_state_space
from sim_backend.errors import ConfigError
from sim_backend.linear import DiscreteModel, ModalModel

if TYPE_CHECKING:
    import control


def to_control(model: ModalModel | DiscreteModel) -> control.StateSpace:
    """Return a model as `control.StateSpace`, continuous or with the sample time of a discrete one.

    Raises ConfigError when an input has a delay, which a state space cannot hold.
    """
    import control

    if isinstance(model, ModalModel):
        _without_delay(model.delay_s)
        return control.ss(*model.state_space())
    return control.ss(*_discrete(model), 1.0 / model.rate_hz)


def from_control(system: Any) -> ModalModel:
    """Return a continuous system of python-control (state space or transfer function) as second-order blocks.

    Raises ConfigError for a sampled system, DataError for one of odd order or with defective eigenvalues.
    """
    import control

    if system.dt not in (None, 0):
        raise ConfigError(f"the system is sampled every {system.dt} s; a model is continuous, convert it first")
    found = control.ss(system)
    return modal_from_state_space(*(np.asarray(part, dtype=float) for part in (found.A, found.B, found.C, found.D)))


def to_scipy(model: ModalModel | DiscreteModel) -> Any:
    """Return a model as `scipy.signal.StateSpace`, continuous or with `dt`; raises ConfigError as `to_control`."""
    from scipy.signal import StateSpace

    if isinstance(model, ModalModel):
        _without_delay(model.delay_s)
        return StateSpace(*model.state_space())
    return StateSpace(*_discrete(model), dt=1.0 / model.rate_hz)


def from_scipy(system: Any) -> ModalModel:
    """Return a continuous system of scipy.signal (tf, zpk or ss) as parallel second-order blocks.

    Raises what `from_control` raises.
    """
    if system.dt is not None:
        raise ConfigError(f"the system is sampled every {system.dt} s; a model is continuous, convert it first")
    found = system.to_ss()
    return modal_from_state_space(*(np.asarray(part, dtype=float) for part in (found.A, found.B, found.C, found.D)))


def _discrete(model: DiscreteModel) -> tuple[Any, Any, Any, Any]:
    from scipy.linalg import block_diag

    _without_delay(model.delay_samples)
    m = model.a.shape[0]
    return block_diag(*model.a), model.b.reshape(2 * m, -1), model.c.reshape(-1, 2 * m), model.d


def _without_delay(delay: Any) -> None:
    if np.any(delay):
        raise ConfigError(
            f"input {int(np.flatnonzero(delay)[0])} has a delay, which a state space cannot hold; take it out with "
            "model.with_(delay_s=...), and add a Padé approximation yourself if you need one"
        )
