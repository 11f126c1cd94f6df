"""The parameters of a ModalModel as one vector, with every derivative that a fit in time or frequency needs.

Each block enters the output only through its position q and rate v under a unit force,

    y = sum over blocks of (N0 q + N1 v) + D u
    N1 = c b_direct' + c_rate b'
    N0 = c (2 sigma b_direct + b)' - omega^2 c_rate b_direct'

so a fit needs only q, v and their derivatives with respect to ln(omega) and ln(sigma): as spectra (rational.py) or as
signals (timefit.py). Logarithms keep every pole in the left half plane and make the units of time irrelevant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from sim_backend.errors import ConfigError
from sim_backend.linear import Array, ModalModel

IntArray = NDArray[np.intp]
FORMS = ("general", "mechanical")

ORDERS_KEPT = 64
"""Numbers of blocks, inputs and outputs for which a process keeps where everything stands: a fit asks in every step."""


@dataclass(frozen=True)
class Layout:
    """Position of each array of a ModalModel in the parameter vector, and which entries a fit may move.

    `free` (p,) is True where the entry moves. Built by `layout_of`.
    """

    n_blocks: int
    n_inputs: int
    n_outputs: int
    free: NDArray[np.bool_]

    def index(self, name: str) -> IntArray:
        """Return the positions of the named array in the vector, in the array's own shape; do not write to it."""
        if name not in self._places:
            raise ConfigError(f"linear model has no parameter {name!r}; it has {', '.join(self._places)}")
        return self._places[name]

    def span(self, name: str) -> slice:
        """Return the position of the named array in the vector."""
        return self._spans[name]

    @cached_property
    def _spans(self) -> dict[str, slice]:
        return _places(self.n_blocks, self.n_inputs, self.n_outputs)[0]

    @cached_property
    def _places(self) -> dict[str, IntArray]:
        return _places(self.n_blocks, self.n_inputs, self.n_outputs)[1]

    @cached_property
    def size(self) -> int:
        """Length of the parameter vector."""
        return self._spans["delay_s"].stop

    @cached_property
    def entries(self) -> IntArray:
        """Positions (n_y, n_u, 6 m + 2) of what one entry of the response depends on; do not write to it.

        They are log_omega, log_sigma, b, b_direct, c, c_rate of every block, D and the delay.
        """
        return _entries(self.n_blocks, self.n_inputs, self.n_outputs)


@lru_cache(maxsize=ORDERS_KEPT)
def _places(m: int, n_u: int, n_y: int) -> tuple[dict[str, slice], dict[str, IntArray]]:
    """Return where each array of so many blocks, inputs and outputs stands, as a slice and in its own shape."""
    shapes: dict[str, tuple[int, ...]] = {
        "log_omega": (m,),
        "log_sigma": (m,),
        "b": (m, n_u),
        "b_direct": (m, n_u),
        "c": (n_y, m),
        "c_rate": (n_y, m),
        "d": (n_y, n_u),
        "delay_s": (n_u,),
    }
    ends = np.cumsum([math.prod(shape) for shape in shapes.values()]).tolist()
    spans = {name: slice(end - math.prod(shape), end) for (name, shape), end in zip(shapes.items(), ends, strict=True)}
    return spans, {name: np.arange(span.start, span.stop).reshape(shapes[name]) for name, span in spans.items()}


@lru_cache(maxsize=ORDERS_KEPT)
def _entries(m: int, n_u: int, n_y: int) -> IntArray:
    _, at = _places(m, n_u, n_y)
    out = np.empty((n_y, n_u, 6 * m + 2), dtype=np.intp)
    for y, u in np.ndindex(n_y, n_u):
        own = [at["log_omega"], at["log_sigma"], at["b"][:, u], at["b_direct"][:, u], at["c"][y], at["c_rate"][y]]
        out[y, u] = np.concatenate([*own, at["d"][y, u : u + 1], at["delay_s"][u : u + 1]])
    return out


@dataclass(frozen=True)
class Structure:
    """What a fit assumes about the plant.

    `form` is "general" or "mechanical" (b_direct = c_rate = 0: each block is c b' / (s² + 2 sigma s + omega²));
    `feedthrough` lets D move, `delay` the delay of each input. `offset` gives each output a constant at rest: a free
    axis has no position of rest, and only readings beside its first have a zero of their own. Raises ConfigError for an
    unknown form.
    """

    form: str = "general"
    feedthrough: bool = True
    delay: bool = False
    offset: bool = True

    def __post_init__(self) -> None:
        if self.form not in FORMS:
            raise ConfigError(f"model form {self.form!r} is unknown; choose one of {', '.join(FORMS)}")


def layout_of(model: ModalModel, structure: Structure) -> Layout:
    """Return the layout of a model's parameters; an omega or a sigma that is zero stays zero."""
    m, n_u, n_y = model.n_blocks, model.n_inputs, model.n_outputs
    free = np.ones(2 * m * (1 + n_u + n_y) + n_y * n_u + n_u, dtype=bool)
    layout = Layout(m, n_u, n_y, free)
    free[layout.span("log_omega")] = model.omega_rad_s > 0.0
    free[layout.span("log_sigma")] = model.sigma_1_s > 0.0
    if structure.form == "mechanical":
        free[layout.span("b_direct")] = False
        free[layout.span("c_rate")] = False
    free[layout.span("d")] = structure.feedthrough
    free[layout.span("delay_s")] = structure.delay
    return layout


def determined(model: ModalModel, layout: Layout) -> NDArray[np.bool_]:
    """Return which parameters (p,) of a canonical model the data determine: the free ones but b = 1, b_direct = 0.

    Each block's coordinates are a choice (see `analysis.linear.modal_form.canonical`); with the choice held fixed, the
    remaining parameters have a covariance of their own.
    """
    mask = layout.free.copy()
    b, direct = layout.index("b"), layout.index("b_direct")
    for i, into in enumerate(zip(model.b.tolist(), model.b_direct.tolist(), strict=True)):
        for u, chosen in enumerate(zip(*into, strict=True)):
            if chosen == (1.0, 0.0):
                mask[b[i, u]] = mask[direct[i, u]] = False
                break
    return mask


def step_limit(layout: Layout) -> Array:
    """Return how far one step may move each free parameter (k,): a factor e in a frequency or a decay rate."""
    limit = np.full(layout.size, np.inf)
    limit[layout.span("log_omega")] = limit[layout.span("log_sigma")] = 1.0
    return limit[layout.free]


def pack(model: ModalModel) -> Array:
    """Return the parameter vector (p,) of a model.

    A zero omega or sigma is stored as its logarithm, -inf, and no fit changes it.
    """
    with np.errstate(divide="ignore"):
        logs = np.log(model.omega_rad_s), np.log(model.sigma_1_s)
    rest = (model.b, model.b_direct, model.c, model.c_rate, model.d, model.delay_s)
    return np.concatenate([*logs, *(a.ravel() for a in rest)])


def unpack(vector: Array, layout: Layout) -> ModalModel:
    """Return the model that a parameter vector (p,) describes."""
    get = {
        name: vector[layout.index(name)]
        for name in ("log_omega", "log_sigma", "b", "b_direct", "c", "c_rate", "d", "delay_s")
    }
    return ModalModel(
        np.exp(get["log_omega"]),
        np.exp(get["log_sigma"]),
        get["b"],
        get["b_direct"],
        get["c"],
        get["c_rate"],
        get["d"],
        np.maximum(get["delay_s"], 0.0),
    )


@dataclass(frozen=True)
class Participation:
    """How blocks enter each output entry, with derivatives; all are linear weights on (q, v).

    Shapes: `n0`, `n1`, `n0_log_omega`, `n0_log_sigma` (m, n_y, n_u); `force` (m, n_u) is 2 sigma b_direct + b.
    """

    n0: Array
    n1: Array
    n0_log_omega: Array
    n0_log_sigma: Array
    force: Array


def participation(model: ModalModel) -> Participation:
    """Return the weights of position and rate of each block in each entry (see the module's equations)."""
    omega2, sigma2 = model.omega_rad_s[:, None] ** 2, 2.0 * model.sigma_1_s[:, None]
    force = sigma2 * model.b_direct + model.b
    c, c_rate = model.c.T[:, :, None], model.c_rate.T[:, :, None]
    direct = model.b_direct[:, None, :]
    rate_part = omega2[:, :, None] * c_rate * direct
    return Participation(
        n0=c * force[:, None, :] - rate_part,
        n1=c * direct + c_rate * model.b[:, None, :],
        n0_log_omega=-2.0 * rate_part,
        n0_log_sigma=sigma2[:, :, None] * c * direct,
        force=force,
    )
