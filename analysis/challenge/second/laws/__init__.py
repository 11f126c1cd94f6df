"""All laws, by location and group: importing this package enters them. A new file needs its line here."""

from analysis.challenge.second.law import LAWS
from analysis.challenge.second.laws import (  # noqa: F401 imported for what they enter
    drive,
    outside_drive,
    outside_motion,
    outside_sensor,
    outside_structure,
    record,
    sensor,
    structure,
    surroundings,
    twisted,
)

__all__ = ["LAWS"]
