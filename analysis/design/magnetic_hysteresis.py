"""Magnetic hysteresis of the actuators as effects of a model, from recorded hysteresis loops."""

from __future__ import annotations

from analysis.measurements.loop_fit import LoopFit
from analysis.recorded.hysteresis import axis_of
from analysis.recorded.loop_fit import HELD, loop_fit_of
from campaigns.log import Run
from campaigns.strategies.design import Design
from sim_backend.model import EffectEntry, Model, Quantity, Value


def with_iron(model: Model, loops: list[Run]) -> Model:
    """Return the model with the magnetic hysteresis of recorded loops, axis by axis; DataError for a log without loops.

    Axes that already have effects on their structure keep those: a model extended by a diagnosis knows its own.
    """
    effects = list(model.effects)
    for run in loops:
        dof = axis_of(run)
        if not any(e.where == dof for e in model.effects):
            stiffness = 1.0 / _compliance(Design(model, model.sample_rate_hz), dof)
            effects += iron_of(loop_fit_of(run), dof, stiffness, f"loops of run {run.run_uid}")
    return Model(**{f: getattr(model, f) for f in model.__struct_fields__ if f != "effects"}, effects=effects)


def iron_of(fit: LoopFit, dof: str, stiffness_nm_rad: float, source: str) -> list[EffectEntry]:
    """Return a loop fit as effects beside springs of `stiffness_nm_rad`, those of the linear model.

    The drive balances K x less the hysteresis torque. The linear model has another stiffness, as it was identified with
    the hysteresis at one amplitude: the difference becomes the linear term of the polynomial.
    """

    def fitted(name: str) -> Value:
        return Quantity(value=fit.parameters[name], origin="fitted", source=source, std=fit.std[name])

    held = {name: Quantity(value=value, origin="printed", source="Table 6.3") for name, value in HELD.items()}
    loop = {"size": fitted("size"), "pinning": fitted("pinning"), **held}
    linear = Quantity(
        value=stiffness_nm_rad - fit.parameters["stiffness"],
        origin="fitted",
        source=f"{source}, less the linear model's stiffness",
        std=fit.std["stiffness"],
    )
    powers = {f"p{6 - power}": fitted(f"power_{power}") for power in (5, 4, 3, 2)}
    polynomial = {**powers, "p5": linear, "p6": fitted("constant")}
    note = "iron of the actuators"
    return [
        EffectEntry(effect="jiles-atherton", where=dof, parameters=dict(loop), note=note),
        EffectEntry(effect="magnetic-polynomial", where=dof, parameters=dict(polynomial), note=note),
    ]


def _compliance(design: Design, dof: str) -> float:
    axis = design.axis(dof)
    return float(((axis.c[0] * axis.b[:, 0]) / axis.omega_rad_s**2).sum() + axis.d[0, 0])
