"""Recorded runs: from the log of one test to its result, one test per file; runs still being recorded as well.

These read channels and the settings of segments, hold results against the requirements, and leave all arithmetic to
`analysis.measurements`.
"""
