"""The names of the strategies on the page, and its terms: one name for each thing."""

from __future__ import annotations

from analysis.design.stages import STAGES
from analysis.paper import figure_6_15, figure_6_18

OWN = figure_6_15.STRATEGIES["designed"]

STRATEGY_NAMES = {
    **{strategy: f"{OWN}: {knows}" for strategy, knows in STAGES.items()},
    **figure_6_15.STRATEGIES,
    **figure_6_18.STRATEGIES,
}
"""What the page calls each strategy of a log; one that is not here is called as in its log."""

TERMS = (
    ("paper, printed", "the number as the paper prints it."),
    (
        "ours, paper's controllers here",
        "the number of this report; where two sets of controllers were played, that of the paper's controllers.",
    ),
    (OWN, "the number of the controller that mccd designs from this campaign's own logs."),
    (
        f"{OWN}: modes …",
        "its controller without learning, with a feed-forward that knows only what stands after the colon.",
    ),
    ("hybrid", "the feed-forward alone moves the mirror, then the feedback closes."),
    ("MbFF", "model-based feed-forward: added while the feedback is always closed."),
    (
        "repetitive",
        "learns the input period by period from the error of the period before, with open feedback; then the input is "
        "kept and the feedback closes.",
    ),
    ("learned input", "hybrid or MbFF control with what repetitive control has learned as feed-forward."),
    ("chop", "moving to and fro between two positions: position 1, where it starts, and position 2."),
    ("α", "direction of a chop: 0° is a rotation about the x-axis (θx), 90° about the y-axis (θy)."),
    ("settling time", "from the start of a move until the error stays within ±1.7 µrad."),
    ("never", "not settled before the next move."),
    (
        "±",
        "one standard deviation beside a value, here and in the figures; the column “tolerance” has its own reasons.",
    ),
    ("seed", "where the random numbers of a simulated bench begin: another seed is other noise."),
    ("cryostat", "the vessel that keeps the mechanism cold; its modes show in θx near 123 Hz and 490 Hz."),
    ("mode", "a resonance: a pair of poles."),
)
"""Terms of the page with what they mean, in the order in which they are read."""
