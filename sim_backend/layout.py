"""How everything that the compiled loop touches is laid out in arrays.

`sim_backend.assembly` and `sim_backend.loops` build these tuples from a Model and a Segment.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backend.effects.compiled import Step

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Plant(NamedTuple):
    """Discrete modes at the substep rate: a (m,2,2), d and rate_d (n_y,n_u), and who drives and who sees a mode.

    Most modes belong to one axis, so only what is not zero is kept: mode m is driven by the inputs `driven_by` with
    gains `b` (.., 2), both from `driven[m]` to `driven[m + 1]`; output i sees the modes `seen_mode` with `c` (.., 4),
    the gains of (q, v) in the position and in the rate, from `seen[i]` to `seen[i + 1]`. A force on mode m alone moves
    it by `push` (m,2).
    `delay_first` (n_u,) and `delay_taps` (n_u, 4) are those of `sim_backend.linear.delay_taps`; `dt_s` the bench's
    sample time; `substeps` steps per sample;
    `feedthrough` is 1 when d is not zero: readings then wait for the torque of their own sample.
    """

    a: Array
    driven: Ints
    driven_by: Ints
    b: Array
    push: Array
    seen: Ints
    seen_mode: Ints
    c: Array
    d: Array
    rate_d: Array
    delay_first: Ints
    delay_taps: Array
    dt_s: float
    substeps: int
    feedthrough: int


class Transducers(NamedTuple):
    """Actuators and sensors, equations (6.1) and (6.2).

    `to_current` (n_a, n_u), `to_torque` (n_u, n_a), `to_heads` (n_s, n_y), `to_reading` (n_y, n_s); `heating` holds
    (cold finger K, thermal resistance K/W, time constant s, actuator steepness (A²/W), 1 if simulated else 0).
    """

    to_current: Array
    to_torque: Array
    to_heads: Array
    to_reading: Array
    heating: Array


class Effects(NamedTuple):
    """All effects of a model, sorted by site: `first` (n_sites + 1,) delimits the sites.

    Neighbours that are the same effect at different locations are called together: `batch` (n_batches + 1,) delimits
    such calls, `site` (n_sites + 1,) says which of them are at a site. Per effect: its compiled step in `steps`,
    `channel`, its number at the site, offsets `p0` and `s0` into `parameters` and `states`, `aux` (an Aux), `column`
    (exogenous column or source channel), `read` (n_e, n_y), the coordinate it watches. Of these rows, and of those of
    the inputs it acts on, `coordinates` and `levers` hold the different ones that are needed, of the first `fast`
    coordinates also the rate, and `watched` and `moved` their numbers; where an effect acts on a mode, rows go on with
    a column for every mode. `wires` (n_e, 7) are the addresses of its signals, filled by `sim_backend.kernel.wires`
    where effects are called; `cells` (5,) is memory for signals given one by one.
    """

    first: Ints
    site: Ints
    batch: Ints
    steps: tuple[Step, ...]
    channel: Ints
    p0: Ints
    s0: Ints
    aux: Ints
    column: Ints
    read: Array
    coordinates: Array
    watched: Ints
    fast: int
    levers: Array
    moved: Ints
    parameters: Array
    states: Array
    wires: Ints
    cells: Array


class Controller(NamedTuple):
    """Feedback and learning per axis (axis i commands input i from reading i).

    Feedback: block filter fa (n,m,2,2), fb (n,m,2), fc (n,m,2), fd (n,); `integrator` (n,) block whose first state is
    the integrator or -1. Learning: filter la, lb, lc, ld alike, `gain` (n,), `lead` (n,) samples, `period` (n,)
    samples, `learning` (n,) 1 while learning, 0 while repeating, -1 when absent; `taps` (n, 2p+1), the zero-phase Q
    filter.
    """

    fa: Array
    fb: Array
    fc: Array
    fd: Array
    integrator: Ints
    la: Array
    lb: Array
    lc: Array
    ld: Array
    gain: Array
    lead: Ints
    period: Ints
    learning: Ints
    taps: Array


class Waveform(NamedTuple):
    """One period of what is played, repeated: `reference` and `feedforward` (period, n_u).

    `events` (n_events, 4): sample in the period, axis, 1 closes and 0 opens the feedback, and the value the
    integrator starts from; sorted by sample. `exogenous` (n_columns, n) covers the whole run.
    """

    reference: Array
    feedforward: Array
    events: Array
    exogenous: Array


class Memory(NamedTuple):
    """What the bench remembers between two runs; changed in place.

    `x` (m,2) modes; `past` (n_u + m,) last torques that depend on motion, on inputs and modes; `has_past` (1,);
    `queue` (n_u, depth) delayed commands; `acting` (n_u,) last torque; `xf` and `xl` (n,m,2) filter states;
    `closed` (n,) feedback closed; `ring` and `learned` (n, L) past learned inputs and filtered errors, L > period + p;
    `samples` (1,) samples played in all; `temperature` (1,) K.
    """

    x: Array
    past: Array
    has_past: Ints
    queue: Array
    acting: Array
    xf: Array
    xl: Array
    closed: Ints
    ring: Array
    learned: Array
    samples: Ints
    temperature: Array


class Output(NamedTuple):
    """What is recorded, from sample `first` on; an array of zero samples is not recorded.

    `command` and `torque` (n_u, n), `current` (n_a, n), `position` and `reading` (n_y, n), `head` (n_s, n),
    `temperature` (n,).
    """

    command: Array
    torque: Array
    current: Array
    position: Array
    reading: Array
    head: Array
    temperature: Array
    first: int


class Bus(NamedTuple):
    """The signals of one sample that effects called by address read and change.

    `driven` (n_u,) the commands behind what acts on them, `current` (n_a,), `torque` (n_u,), `head` (n_s,), `reading`
    (n_y,). `source` holds what effects can receive as auxiliary signal: zero, the temperature, the commands, the
    positions and the drawn numbers (n_columns). `at`, `speed` and `middle` are the coordinates that effects watch,
    their rates, and where they will be at mid-step; `force` is what effects add along their levers.
    """

    source: Array
    driven: Array
    current: Array
    torque: Array
    head: Array
    reading: Array
    at: Array
    speed: Array
    middle: Array
    force: Array


class Parts(NamedTuple):
    """All that a loop is made for and that stays with its bench: what `Loop`, its structure and its table are of."""

    plant: Plant
    hw: Transducers
    fx: Effects
    ctl: Controller
    mem: Memory
    bus: Bus
