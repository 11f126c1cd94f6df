"""Blind challenges: benches with hidden effects, their logs, the sealed truth, and the score of a diagnosis."""
