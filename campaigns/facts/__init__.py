"""What is known of a record before it is used: one fact per file, all of them listed in `finding`.

Facts are found when data are imported and kept in the log; identification and diagnosis ask them, never the raw
samples.
"""

from campaigns.facts.base import Fact, Seen
from campaigns.facts.dead import dead_in_all
from campaigns.facts.finding import (
    FACTS,
    RELATIONS,
    all_facts_of,
    facts_of,
    found_in,
    missing_in,
    seen_in,
    stored_facts,
    whole,
)
from campaigns.facts.sizes import sizes_of
from campaigns.facts.usable import measured_segments, remarks_on, usable_segments

__all__ = [
    "FACTS",
    "RELATIONS",
    "Fact",
    "Seen",
    "all_facts_of",
    "dead_in_all",
    "facts_of",
    "found_in",
    "measured_segments",
    "missing_in",
    "remarks_on",
    "seen_in",
    "sizes_of",
    "stored_facts",
    "usable_segments",
    "whole",
]
