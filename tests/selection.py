"""What `make test` leaves to `make test-all`: the one place that decides, with the reason."""

from __future__ import annotations

from fnmatch import fnmatchcase

ONE_PER_SITE = {
    "amplifier-lag",
    "damping-shift",
    "dropped-samples",
    "end-stop-contact",
    "position-dependent-force-constant",
    "sensor-quantisation",
}
"""Blind families that stay in `make test`: the quickest at each site of the loop at which a family acts."""

BLIND = "tests/end_to_end/test_blind_families.py::test_a_hidden_cause_is_named_and_adding_it_pays"

THOROUGH = (
    ("end_to_end/test_blind_families.py::test_two_hidden_causes_*", "pairs take a minute each"),
    ("end_to_end/test_mirror.py::*", "the measured mirror takes five minutes"),
    ("benchmarks/test_speed.py::test_all_compute_the_same*diagnosis*", "a panel of diagnoses"),
    ("benchmarks/test_speed.py::test_all_compute_the_same*paper*", "the whole report, which others make in small"),
    ("benchmarks/test_speed.py::test_all_compute_the_same*log-commands*", "commands on a long log"),
    ("analysis/diagnosis/spread/test_shaking.py::test_none_is_found_in_coloured_noise_alone", "sixty searches"),
    ("end_to_end/test_linear_benches.py::*", "a minute each"),
)
"""Patterns of node IDs below tests/, and why these tests are left to the longer run."""


def is_thorough(nodeid: str) -> bool:
    """Tell whether a test runs in `make test-all` only."""
    if nodeid.startswith(BLIND):
        return nodeid[len(BLIND) :].strip("[]") not in ONE_PER_SITE
    # in a pattern "[" begins a set of letters, so parameters are matched by "*"
    return any(fnmatchcase(nodeid, f"tests/{pattern}") for pattern, _ in THOROUGH)
