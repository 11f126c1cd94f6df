"""Where measured data lie that are not part of the project, and the mark of what is tested on them alone."""

from __future__ import annotations

from pathlib import Path

import pytest

MIRROR = Path(__file__).resolve().parents[2] / "shared" / "data" / "fsm"
"""The measured fast-steering mirror: three drives, three displacements, three levels; beside the repository."""

needs_mirror = pytest.mark.skipif(not MIRROR.is_dir(), reason=f"measured mirror data are not at {MIRROR}")
