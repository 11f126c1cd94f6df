"""Which delays of a model are re-tuned: those that were fitted to the very runs, and no others."""

from __future__ import annotations

from analysis.diagnosis.records.own_runs import fitted_delays
from sim_backend.model import Mode, Model, Port, Quantity, Value

OWN, FOREIGN = "free fit to run a1", "free fit to run b2"


def test_only_a_delay_that_was_fitted_to_the_same_run_is_re_tuned() -> None:
    delays: dict[str, Value] = {
        "own": Quantity(value=1e-3, origin="fitted", source=OWN, std=1e-5),
        "foreign": Quantity(value=1e-3, origin="fitted", source=FOREIGN, std=1e-5),
        "set": Quantity(value=1e-3, origin="fitted", source=OWN, std=0.0),
        "stated": 1e-3,
        "none": Quantity(value=0.0, origin="fitted", source=OWN, std=1e-5),
    }
    model = Model(
        name="model",
        sample_rate_hz=1e3,
        inputs=[Port(name=name, unit="V", dof=name) for name in (*delays, "unsaid")],
        outputs=[Port(name="y", unit="m", dof="own")],
        modes=[Mode(label="mode 1", frequency_hz=10.0, decay_rate_1_s=1.0, input={"own": 1.0}, output={"y": 1.0})],
        delay_s=delays,
    )
    assert fitted_delays(model, ["a1"]) == [0]
