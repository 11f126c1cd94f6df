"""The segment that the benchmarks of the full bench play."""

from __future__ import annotations

from campaigns.plans.chop import ChopPlan
from sim_backend.bench import Segment
from sim_backend.model import load_model
from sim_backend.simbench import SimBench

SAMPLES, QUICK, SEED = 600_000, 20_000, 1
RATE_HZ = 10_000.0


def chopping(n: int) -> Segment:
    """Return a chop along 30 degrees, so that two axes move, with all loops closed all the time; every channel kept."""
    plan = ChopPlan(strategy="mbff", alpha_deg=30.0)
    chop = next(s for s in plan.segments(SimBench(load_model("as-built"), 0)) if s.label.startswith("chop"))
    return Segment("full", n, chop.reference, chop.feedforward, chop.feedback, chop.gates)
