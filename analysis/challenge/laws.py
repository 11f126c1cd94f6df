"""Torques that depend on the motion, in formulas of the challenge's own, and the loop that advances them.

They are evaluated in the middle of every fine step. All that is compiled is in this one file, because a compiler's
cache does not see changes in others.

Each law gets the position and rate at mid-step, the change of position since the last one, the drive, the temperature
(difference from the start), its parameters `p` and its memory `s`, and returns the torque it adds.
"""

from __future__ import annotations

import math

import numpy as np

from sim_backend.jit import njit

CUBIC, FRICTION, BOUC_WEN, JILES_ATHERTON, IWAN, CREEP, STOP, PLAY, COGGING, FORCE_CONSTANT, THERMAL = range(11)

MEMORY = 32
"""Size of the memory of one law, in numbers."""


@njit
def friction(v, dx, p, s):  # type: ignore[no-untyped-def]
    """LuGre: bristles of stiffness p[2] slip at p[0], at rest at p[0] p[1] (Canudas de Wit et al., IEEE TAC 40, 1995).

    The bristle's equation is solved exactly over a step at one level, so it never goes unstable.
    """
    level = p[0] * (1.0 + (p[1] - 1.0) * math.exp(-((v / p[3]) ** 2)))
    if dx != 0.0 and level > 0.0:
        end = level / p[2] * (1.0 if dx > 0.0 else -1.0)
        s[0] = end + (s[0] - end) * math.exp(-p[2] * abs(dx) / level)
    return -p[2] * s[0]


@njit
def bouc_wen(dx, p, s):  # type: ignore[no-untyped-def]
    """Bouc–Wen, exponent 1: dz/dx = 1 - |z| (beta sign(z dx) + gamma) / reach, torque -p[0] z (Wen, ASCE EM2, 1976)."""
    way = 1.0 if dx > 0.0 else -1.0
    for _ in range(4):
        h = 0.25 * dx
        z = s[0]
        slope = 1.0 - abs(z) / p[1] * (p[2] * (1.0 if z * way > 0.0 else -1.0) + (1.0 - p[2]))
        z += 0.5 * h * slope
        slope = 1.0 - abs(z) / p[1] * (p[2] * (1.0 if z * way > 0.0 else -1.0) + (1.0 - p[2]))
        s[0] += h * slope
    return -p[0] * s[0]


@njit
def langevin(x):  # type: ignore[no-untyped-def]
    """Return coth x - 1/x."""
    if abs(x) < 0.05:
        return x / 3.0 - x**3 / 45.0 + 2.0 * x**5 / 945.0
    return 1.0 / math.tanh(x) - 1.0 / x


@njit
def jiles_atherton(x, dx, p, s):  # type: ignore[no-untyped-def]
    """Jiles and Atherton 1986 without coupling, in the irreversible magnetisation s[0]; M = (1 - c) Mirr + c Man.

    dMirr/dH = (Man - Mirr) / (sign(dH) k), none while the field turns back; the middle of the step by a half step.
    """
    way = 1.0 if dx > 0.0 else -1.0
    half = s[0]
    gap = langevin((x - dx) / p[1]) - half
    if gap * way > 0.0:
        half += 0.5 * dx * gap * way / p[2]
    gap = langevin((x - 0.5 * dx) / p[1]) - half
    if gap * way > 0.0:
        s[0] += dx * gap * way / p[2]
    return p[0] * ((1.0 - p[3]) * s[0] + p[3] * langevin(x / p[1]))


@njit
def iwan(dx, p, s):  # type: ignore[no-untyped-def]
    """Thirty equal springs in parallel that slip at strokes evenly spaced up to p[1] (Iwan, J. Appl. Mech. 1966)."""
    total = 0.0
    for i in range(30):
        reach = p[1] * (i + 1.0) / 30.0
        s[i] = min(max(s[i] + dx, -reach), reach)
        total += s[i]
    return -p[0] * total / 30.0


@njit
def torque(law, x, v, dx, u, kelvin, dt_s, p, s):  # type: ignore[no-untyped-def]
    """Return the torque of a law; see the module for the arguments."""
    if law == CUBIC:
        return -p[0] * x**3
    if law == FRICTION:
        return friction(v, dx, p, s)
    if law == BOUC_WEN:
        return bouc_wen(dx, p, s)
    if law == JILES_ATHERTON:
        return jiles_atherton(x, dx, p, s)
    if law == IWAN:
        return iwan(dx, p, s)
    if law == CREEP:
        # the spring relaxes towards the mean position of the step
        goal = x - 0.5 * dx
        s[0] = goal + (s[0] - goal) * math.exp(-dt_s / p[1])
        return p[0] * s[0]
    if law == STOP:
        deep = max(abs(x) - p[2], 0.0)
        return -deep * (p[0] * (1.0 if x > 0.0 else -1.0) + p[1] * v)
    if law == PLAY:
        return p[0] * min(max(x, -p[1]), p[1])
    if law == COGGING:
        return p[0] * math.sin(2.0 * math.pi * x / p[1] + p[2])
    if law == FORCE_CONSTANT:
        return u * x * (p[0] + p[1] * x)
    return -p[0] * kelvin * x


@njit
def advance(whole, half, b, c, drive, kelvin, laws, axes, p, memory, dt_s, q, position, rate):  # type: ignore[no-untyped-def]
    """Fill `position` and `rate` step by step; `whole` and `half` are (transition, response) of those steps."""
    step, push = whole
    step_half, push_half = half
    n_modes, n_axes = b.shape
    added, last, total = np.zeros(n_axes), np.zeros(laws.size), np.zeros(n_axes)
    for k in range(drive.shape[0]):
        for a in range(n_axes):
            x, v = 0.0, 0.0
            for m in range(n_modes):
                x += c[a, m] * q[m, 0]
                v += c[a, m] * q[m, 1]
            position[k, a], rate[k, a] = x, v
        if laws.size:
            if k == 0:
                for i in range(laws.size):
                    last[i] = position[0, axes[i]]
            for a in range(n_axes):
                total[a] = 0.0
            for i in range(laws.size):
                x, v = 0.0, 0.0
                for m in range(n_modes):
                    f = 0.0
                    for a in range(n_axes):
                        f += b[m, a] * (drive[k, a] + added[a])
                    x += c[axes[i], m] * (
                        step_half[m, 0, 0] * q[m, 0] + step_half[m, 0, 1] * q[m, 1] + push_half[m, 0] * f
                    )
                    v += c[axes[i], m] * (
                        step_half[m, 1, 0] * q[m, 0] + step_half[m, 1, 1] * q[m, 1] + push_half[m, 1] * f
                    )
                u = drive[k, axes[i]]
                total[axes[i]] += torque(laws[i], x, v, x - last[i], u, kelvin[k], dt_s, p[i], memory[i])
                last[i] = x
            for a in range(n_axes):
                added[a] = total[a]
        for m in range(n_modes):
            f = 0.0
            for a in range(n_axes):
                f += b[m, a] * (drive[k, a] + added[a])
            x, v = q[m, 0], q[m, 1]
            q[m, 0] = step[m, 0, 0] * x + step[m, 0, 1] * v + push[m, 0] * f
            q[m, 1] = step[m, 1, 0] * x + step[m, 1, 1] * v + push[m, 1] * f
