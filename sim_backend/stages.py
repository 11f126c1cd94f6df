"""The parts of the time loop that do most of its arithmetic, compiled each on its own and called by address.

Within the loop they would share the registers with some sixty arrays, and moving those about took longer than the
arithmetic. Here every array is a bare pointer to its numbers, in the layout that `sim_backend.layout` describes.
"""

from __future__ import annotations

from llvmlite import ir
from numba import cfunc, types

from sim_backend.effects.compiled import intrinsic

_WHOLE, _NUMBERS, _WHOLES = types.intp, types.CPointer(types.float64), types.CPointer(types.intp)


@intrinsic
def call(typingctx, address, arguments):  # type: ignore[no-untyped-def]
    """Call the compiled function at `address` with a tuple of whole numbers and addresses; it returns nothing."""
    signature = types.void(types.intp, arguments)

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        values = [builder.extract_value(args[1], i) for i in range(len(arguments))]
        function = ir.FunctionType(ir.VoidType(), [value.type for value in values])
        builder.call(builder.inttoptr(args[0], function.as_pointer()), values)
        return context.get_dummy_value()

    return signature, codegen


@cfunc(types.void(_WHOLE, _WHOLE, _WHOLES, _WHOLES, *[_NUMBERS] * 6), cache=True, forceinline=True)
def motion(n_y, n_u, seen, seen_mode, c, x, rate_d, torque, position, rate):  # type: ignore[no-untyped-def]
    """Fill positions and rates from the modal states `x` (m, 2) and the torque in force."""
    for i in range(n_y):
        at, speed = 0.0, 0.0
        for s in range(seen[i], seen[i + 1]):
            q, v = x[2 * seen_mode[s]], x[2 * seen_mode[s] + 1]
            at += c[4 * s] * q + c[4 * s + 1] * v
            speed += c[4 * s + 2] * q + c[4 * s + 3] * v
        through = 0.0
        for j in range(n_u):
            through += rate_d[n_u * i + j] * torque[j]
        position[i], rate[i] = at, speed + through


@cfunc(types.void(_WHOLE, _NUMBERS, _WHOLES, _WHOLES, *[_NUMBERS] * 3), cache=True, forceinline=True)
def advance(n_modes, a, driven, driven_by, b, torque, x):  # type: ignore[no-untyped-def]
    """Step every mode once under a held torque."""
    for m in range(n_modes):
        x0, x1 = x[2 * m], x[2 * m + 1]
        n0 = a[4 * m] * x0 + a[4 * m + 1] * x1
        n1 = a[4 * m + 2] * x0 + a[4 * m + 3] * x1
        for d in range(driven[m], driven[m + 1]):
            n0 += b[2 * d] * torque[driven_by[d]]
            n1 += b[2 * d + 1] * torque[driven_by[d]]
        x[2 * m], x[2 * m + 1] = n0, n1


@cfunc(types.void(_WHOLE, _WHOLE, *[_NUMBERS] * 5, _WHOLES, *[_NUMBERS] * 4), cache=True, forceinline=True)
def feedback(n, n_blocks, a, b, c, d, x, closed, reference, feedforward, reading, command):  # type: ignore[no-untyped-def]
    """Fill the commands: the feed-forward, and where the loop is closed the output of the axis' block filter."""
    for i in range(n):
        out = feedforward[i]
        if closed[i] == 1:
            error = reference[i] - reading[i]
            back = d[i] * error
            for k in range(n_blocks * i, n_blocks * (i + 1)):
                x0, x1 = x[2 * k], x[2 * k + 1]
                back += c[2 * k] * x0 + c[2 * k + 1] * x1
                x[2 * k] = a[4 * k] * x0 + a[4 * k + 1] * x1 + b[2 * k] * error
                x[2 * k + 1] = a[4 * k + 2] * x0 + a[4 * k + 3] * x1 + b[2 * k + 1] * error
            out += back
        command[i] = out


@cfunc(types.void(*[_WHOLE] * 7, *[_NUMBERS] * 11), cache=True, forceinline=True)
def learn(  # type: ignore[no-untyped-def]
    now, period, lead, active, length, n_taps, n_blocks, taps, gain, error, a, b, c, d, x, ring, learned, command
):
    """Add an axis' repetitive input u_k = Q (u_{k-N} + k_r L e_{k-N+lead}) to its command; remember it and L e_k.

    All are the axis' own: `ring` and `learned` (length,) hold past inputs and filtered errors, `gain`, `d`, `error` and
    `command` single numbers. While repeating (active 0) the input of one period ago is played again.
    """
    before = now - period
    if active == 0:
        out = ring[before % length]
    else:
        past = (before - n_taps // 2) % length
        correction = (past + lead) % length
        out = 0.0
        for t in range(n_taps):
            out += taps[t] * (ring[past] + gain[0] * learned[correction])
            past = past + 1 if past + 1 < length else 0
            correction = correction + 1 if correction + 1 < length else 0
    filtered = d[0] * error[0]
    for k in range(n_blocks):
        x0, x1 = x[2 * k], x[2 * k + 1]
        filtered += c[2 * k] * x0 + c[2 * k + 1] * x1
        x[2 * k] = a[4 * k] * x0 + a[4 * k + 1] * x1 + b[2 * k] * error[0]
        x[2 * k + 1] = a[4 * k + 2] * x0 + a[4 * k + 3] * x1 + b[2 * k + 1] * error[0]
    ring[now % length], learned[now % length] = out, filtered
    command[0] += out


STAGES = (motion, advance, feedback, learn)
"""In the order in which `sim_backend.layout.Bus.stages` holds their addresses."""
