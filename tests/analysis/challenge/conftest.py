"""A short hidden campaign that tests share."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.challenge.campaign import Campaign, draw_campaign


@pytest.fixture(scope="session")
def short_one() -> Campaign:
    return draw_campaign(np.random.default_rng(11), "short", 1)


@pytest.fixture(scope="session")
def short_two() -> Campaign:
    return draw_campaign(np.random.default_rng(12), "short", 2)
