"""Where measured data lie that are not part of the project, and the marks of what is tested on them alone."""

from __future__ import annotations

from pathlib import Path

import pytest

_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

MIRROR = _DATA / "fsm"
"""The measured fast-steering mirror: three drives, three displacements, three levels; beside the repository."""

TANKS = _DATA / "cascaded-tanks"
"""Two measured water tanks, pump voltage to level: a record to fit and one to judge by (nonlinearbenchmark.org)."""

ROBOT_ARM = _DATA / "robot-arm"
"""A measured flexible robot arm, torque to acceleration, 1,024 samples (DaISy collection, KU Leuven)."""

needs_mirror = pytest.mark.skipif(not MIRROR.is_dir(), reason=f"measured mirror data are not at {MIRROR}")
needs_tanks = pytest.mark.skipif(not TANKS.is_dir(), reason=f"measured data of two tanks are not at {TANKS}")
needs_robot_arm = pytest.mark.skipif(not ROBOT_ARM.is_dir(), reason=f"measured robot-arm data are not at {ROBOT_ARM}")
