"""Fig. 6.5: magnitude of the θx plant, measured and fitted."""

from __future__ import annotations

import numpy as np

from analysis.pages.canvas import OURS, PAPER, Canvas
from analysis.paper.measured import Measured
from analysis.paper.numbers import paper_tables
from sim_backend.model import load_model

TICKS_HZ = (5, 10, 20, 50, 100, 200, 500, 1000, 2000)


def figure_6_5(measured: Measured) -> Canvas | None:
    """Return the sweep, the fit in the paper's order, the printed polynomial, and the resonances of Table 6.1."""
    sweep, model = measured.sweep("theta_x"), measured.paper_model("theta_x")
    if sweep is None or model is None:
        return None
    canvas = Canvas(
        "Bode magnitude of the θx plant",
        "Stepped sine on the bench, the 8th-order model of it, and the polynomial as printed in Table 6.2. As in the "
        "paper, one broad mode of the model stands for the two sharp resonances. "
        "Ticks on top mark the resonances that the paper measured (Table 6.1).",
        size=(7.2, 4.0),
    )
    f = np.geomspace(5.0, 2000.0, 1600)
    axes = canvas.panel(0, "", "frequency (Hz)", "magnitude (dB re 1 mrad/N m)")
    printed = load_model("printed").linear().frequency_response(f)[:, 0, 0]
    fitted = model.frequency_response(f, 10_000.0)[:, 0, 0]
    canvas.line(0, "Table 6.2 as printed", f, _db(printed), color=PAPER, linestyle="--", linewidth=1.0)
    canvas.line(0, "8th-order model", f, _db(fitted), color="#1b1b1f", linewidth=0.9)
    canvas.points(0, "sweep", sweep.frequency_hz, _db(sweep.response), color=OURS, markersize=2.6)
    axes.set_xscale("log")
    axes.set_xlim(4.5, 2700.0)
    axes.margins(y=0.12)
    table = paper_tables()["6.1"]
    for key in ("measured 1", "measured 2", "measured 3"):
        hz = table.value(key)
        axes.axvline(hz, ymin=0.97, ymax=1.0, color=PAPER, linewidth=1.4)
        # the pair is close: one label to the left of it, one to the right
        side, gap = ("right", -3) if key == "measured 2" else ("left", 3)
        canvas.note(0, f"{hz:.1f} Hz", hz, 1.0, (gap, -8), ha=side, va="top", color=PAPER)
    axes.set_xticks(TICKS_HZ, [f"{hz:g}" for hz in TICKS_HZ])
    axes.set_xticks([], minor=True)
    canvas.legend(0, loc="lower left")
    return canvas


def _db(response: np.ndarray) -> np.ndarray:
    return 20.0 * np.log10(np.abs(response) * 1e3)
