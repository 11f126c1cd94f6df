"""Effects in words: each of the library, and what measures it."""

from __future__ import annotations

import pytest

from analysis.diagnosis.answer.words import measure_text
from analysis.diagnosis.result import NOTHING_ADDED, Visible, hypothesis_text
from sim_backend.effects import named
from sim_backend.effects.words import effect_text, with_effects


def test_every_effect_of_the_library_has_words() -> None:
    texts = {e.reported(): effect_text(e.reported()) for e in named()}
    assert texts["cubic-stiffness"] == "cubic stiffness" and texts["coulomb-friction"] == "Coulomb friction"
    # two effects in the same words would be one to a reader
    assert len(set(texts.values())) == len(texts)


def test_what_is_no_slug_stays() -> None:
    for text in ("noise of a reading in a band", "x-ray <b>", "Theta-1"):
        assert effect_text(text) == text


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("coulomb-friction at theta_x: torque", "Coulomb friction at theta_x: torque"),
        ("delay at x, cross-coupling at x->y", "delay at x, cross-coupling at x->y"),
        ("run cubic-stiffness.h5 at 10 kHz", "run cubic-stiffness.h5 at 10 kHz"),
        ("--without dead-zone", "--without dead-zone"),
    ],
)
def test_effects_before_their_location_are_written_in_words(key: str, text: str) -> None:
    assert with_effects(key) == text


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (NOTHING_ADDED, "nothing added"),
        ("delay+sensor-gain", "delay and sensor gain"),
    ],
)
def test_hypotheses_are_sets_of_effects(name: str, text: str) -> None:
    assert hypothesis_text(name) == text


def test_sizes_are_named_by_what_they_measure() -> None:
    def measured(effect: str, parameter: str) -> str:
        return measure_text(Visible(effect, "x", parameter, 1.0, "1"))

    assert measured("fringe-jump", "fringe") == "reading of one fringe"
    assert measured("hysteresis", "stiffness_1") == "stiffness of the spring that slips last"
    assert measured("mine", "own_size") == "own size"
