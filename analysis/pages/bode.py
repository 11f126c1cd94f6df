"""The axes of a Bode diagram: magnitude above phase, over the logarithm of the frequency."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.pages.canvas import Array, Canvas

PHASES_DEG = (-180, -90, 0, 90, 180)


def bode_canvas(title: str, entry: str, unit: str, size: tuple[float, float], rows: int = 2) -> Canvas:
    """Return a canvas with panels for magnitude and phase of an `entry` in a `unit` that may be empty.

    Of more `rows` than two the lower ones are the caller's.
    """
    canvas = Canvas(title, "", rows=rows, size=size, share_x=True)
    canvas.panel(0, entry, "", f"magnitude ({unit})" if unit else "magnitude")
    canvas.panel(1, "", "frequency (Hz)" if rows == 2 else "", "phase (°)")
    return canvas


def per(over: str, under: str) -> str:
    """Return the unit of one port per that of another; empty where both are plain numbers."""
    return "" if (over, under) == ("1", "1") else f"{over} per {under}"


def draw_response(canvas: Canvas, name: str, f: Array, response: NDArray[np.complex128], **style: Any) -> None:
    """Draw a response (n,) at frequencies (n,) in Hz; its phase is not drawn across the picture where it wraps."""
    phase_deg = np.degrees(np.angle(response))
    wraps = np.flatnonzero(np.abs(np.diff(phase_deg)) > 180.0) + 1
    canvas.line(0, name, f, np.abs(response), **style)
    canvas.line(1, name, np.insert(f, wraps, f[wraps]), np.insert(phase_deg, wraps, np.nan), **style)


def scale_axes(canvas: Canvas) -> None:
    """Make the axes of the frequency and of the magnitude logarithmic, once everything is drawn."""
    for axes in canvas.axes:
        axes.set_xscale("log")
    canvas.axes[0].set_yscale("log")
