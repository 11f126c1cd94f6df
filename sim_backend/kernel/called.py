"""What happens seldom or is long: compiled once for all benches and called by the emitted loop by address.

Every array is a bare pointer to its numbers, in the layout that `sim_backend.layout` describes.
"""

from __future__ import annotations

from typing import Any

from sim_backend.effects.compiled import call_loop, load, store
from sim_backend.jit import Deferred, cfunc, njit

types: Any = Deferred("numba", "types")
_WHOLE, _NUMBERS, _WHOLES = "intp", "CPointer(float64)", "CPointer(intp)"


def _signature(returned: str, *arguments: str) -> str:
    return f"{returned}({', '.join(arguments)})"


@cfunc(_signature("intp", *[_WHOLE] * 4, _NUMBERS, _WHOLES, _NUMBERS, _NUMBERS, _WHOLES), error_model="numpy")
def gate(k, event, n_events, n_blocks, events, integrator, c, x, closed):  # type: ignore[no-untyped-def]
    """Open and close the feedback at the events (n_events, 4) of sample `k`; return the row of the next event.

    A loop that closes starts from rest, its integrator from the value of the event. `c` and `x` are the outputs and the
    states of the block filters (n, n_blocks, 2).
    """
    while event < n_events and int(events[4 * event]) == k:
        axis, closing = int(events[4 * event + 1]), int(events[4 * event + 2])
        first = 2 * n_blocks * axis
        if closing == 1 and closed[axis] == 0:
            for i in range(first, first + 2 * n_blocks):
                x[i] = 0.0
            if integrator[axis] >= 0:
                own = first + 2 * integrator[axis]
                x[own] = events[4 * event + 3] / c[own]
        closed[axis] = closing
        event += 1
    return event


@cfunc(_signature("void", *[_WHOLE] * 5, *[_WHOLES] * 3, *[_NUMBERS] * 11), error_model="numpy")
def learn(  # type: ignore[no-untyped-def]
    i, now, length, n_taps, n_blocks, period, lead, active, taps, gain, a, b, c, d, x, ring, learned, error, command
):
    """Add axis i's repetitive input u_k = Q (u_{k-N} + k_r L e_{k-N+lead}) to its command; remember it and L e_k.

    `ring` and `learned` (n, length) hold past inputs and filtered errors, `error` and `command` single numbers. While
    repeating (active 0) the input of one period ago is played again.
    """
    own = i * length
    before = now - period[i]
    if active[i] == 0:
        out = ring[own + before % length]
    else:
        past = (before - n_taps // 2) % length
        correction = (past + lead[i]) % length
        out = 0.0
        for t in range(i * n_taps, (i + 1) * n_taps):
            out += taps[t] * (ring[own + past] + gain[i] * learned[own + correction])
            past = past + 1 if past + 1 < length else 0
            correction = correction + 1 if correction + 1 < length else 0
    filtered = d[i] * error[0]
    for k in range(i * n_blocks, (i + 1) * n_blocks):
        x0, x1 = x[2 * k], x[2 * k + 1]
        filtered += c[2 * k] * x0 + c[2 * k + 1] * x1
        x[2 * k] = a[4 * k] * x0 + a[4 * k + 1] * x1 + b[2 * k] * error[0]
        x[2 * k + 1] = a[4 * k + 2] * x0 + a[4 * k + 3] * x1 + b[2 * k + 1] * error[0]
    ring[own + now % length], learned[own + now % length] = out, filtered
    command[0] += out


@njit
def along(address, wires, cells, signal, position, rate, aux, dt_s, out):  # type: ignore[no-untyped-def]
    """Fill `out` (n,) with what the step at `address` adds along signals (n,); `cells` (5,) are those of a sample."""
    cell = types.intp(cells.ctypes.data)
    for k in range(signal.size):
        store(cell, signal[k])
        store(cell + 8, position[k])
        store(cell + 16, rate[k])
        store(cell + 24, aux[k])
        store(cell + 32, 0.0)
        call_loop(address, 1, types.intp(wires.ctypes.data), dt_s)
        out[k] = load(cell + 32)
