"""A linear model from stepped sines, one axis per log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from analysis.identification.growing_poles import remarks_on_growth
from analysis.identification.identified import Fitted, Identification, identification, side_by_side
from analysis.identification.record_remarks import remarks_on_records, untold
from analysis.identification.response_curves import ResponseCurve, curve_of_sweep
from analysis.identification.sweep_fit import fit_sweep
from analysis.recorded.sweep import sweep_of
from campaigns.log import ROLES, Channel, Run
from campaigns.progress import Report
from sim_backend.errors import DataError
from sim_backend.linear import Array
from sim_backend.model import Port


def identify_sweeps(
    runs: Sequence[Run],
    orders: tuple[int, ...],
    name: str,
    report: Report,
    tell: Callable[[str], None] = untold,
) -> Identification:
    """Return one model of all axes, one per run: their modes side by side, without coupling.

    Raises DataError for a log that a fact forbids to use, and for two logs of one axis.
    """
    fits: dict[str, Fitted] = {}
    inputs: list[Channel] = []
    outputs: list[Channel] = []
    curves: list[ResponseCurve] = []
    may_grow: list[ResponseCurve] = []
    remarks: list[str] = []
    known = remarks_on_records(runs)
    for remark in known:
        tell(remark)
    for i, run in enumerate(runs):
        report(i, len(runs), f"fitting {run.path.name}")
        sweep = sweep_of(run)
        if sweep.axis in fits:
            raise DataError(f"{run.path} sweeps {sweep.axis}, as another log does; give one sweep per axis")
        fits[sweep.axis], told = fit_sweep(sweep, run.sample_rate_hz, orders)
        remarks += told
        into, out = ([c for c in run.channels.values() if (c.role, c.dof) == (r, sweep.axis)] for r in ROLES[:2])
        curves.append(curve_of_sweep(sweep, into[0].name, out[0].name))
        # what is swept without a loop, as a bench is here, and comes to rest again cannot grow
        if run.header.bench.get("kind") == "imported" or run.names("reference"):
            may_grow.append(curves[-1])
        inputs += into
        outputs += out
    each = [[i] for i in range(len(fits))]
    linear = side_by_side([fit.linear for fit in fits.values()], each, each)
    std = side_by_side([fit.std for fit in fits.values()], each, each)
    dropped = tuple(one for fit in fits.values() for one in fit.dropped)
    chi2, dof = sum(f.chi2 or 0.0 for f in fits.values()), sum(f.dof for f in fits.values())
    whole = Fitted(linear, std, chi2, dof, dropped=dropped, gain_std=_beside([fit.gain_std for fit in fits.values()]))
    ports = ([Port(name=c.name, unit=c.unit, dof=c.dof) for c in some] for some in (inputs, outputs))
    found = identification(whole, runs, *ports, method="stepped sine", name=name, response=tuple(curves))
    grows = remarks_on_growth(found.model, may_grow)
    return replace(found, remarks=(*known, *grows, *found.remarks, *remarks))


def _beside(parts: Sequence[Array | None]) -> Array | None:
    """Return the deviations of gains (1, 1) of all axes as one matrix, without coupling."""
    known = [part for part in parts if part is not None]
    return np.diag(np.concatenate(known).ravel()) if len(known) == len(parts) else None
