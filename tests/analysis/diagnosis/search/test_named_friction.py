"""A sharp friction on a bench is called friction: rivals whose shapes end at a bound must not win by a rounding."""

from __future__ import annotations

import msgspec
import numpy as np

from analysis.diagnosis.pipeline import Options, diagnose
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.records.holding import with_held_out
from campaigns.plans import make_plan
from campaigns.playing.recording import play_in_memory
from sim_backend.model import EffectEntry, load_model
from sim_backend.simbench import SimBench

TORQUE_NM = 1e-4


def test_friction_is_not_taken_for_hysteresis():
    """The rival of Jiles and Atherton ends with one shape at zero, where it has no slope and its evidence none."""
    bench = load_model("docs/examples/quiet.toml")
    friction = EffectEntry(effect="coulomb-friction", where="theta_x", parameters={"torque": TORQUE_NM})
    bench = msgspec.structs.replace(bench, effects=[*bench.effects, friction])
    settings = {"axes": ["theta_x"], "torque_rms_nm": 0.01, "stop_hz": 200.0, "period_s": 0.5, "realisations": 1}
    played = play_in_memory(make_plan("multisine", settings), SimBench(bench, 1))
    windows = tuple(
        Window(s.label, s.start, s.stop, s.held_out, int(s.settings["period_samples"])) for s in played.segments
    )
    u, y = (np.asarray(played.read(name))[:, None] for name in ("command_theta_x", "theta_x"))
    held, _ = with_held_out([Record("played", u, y, windows)])
    options = Options(without=("vibration-line",), max_effects=1)
    found = diagnose(Dataset(played.sample_rate_hz, held), load_model("docs/examples/nominal.toml"), options)
    assert found.verdict == "named", found.sentence
    assert [cause.effect for cause in found.causes] == ["coulomb-friction"]
    torque = found.causes[0].parameters["torque"]
    # held torques act (ωT)²/3 too strongly at most, 6e-4 at 200 Hz in four steps a sample, beside four deviations
    assert abs(torque.value - TORQUE_NM) < 4.0 * torque.std + 1e-3 * TORQUE_NM
