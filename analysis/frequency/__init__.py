"""Frequency responses of recorded data, with noise and distortion separated."""
