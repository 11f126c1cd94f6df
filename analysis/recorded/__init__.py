"""Measurements of recorded runs: from the log of one test to its result, one test per file.

These read channels and the settings of segments, and leave all arithmetic to the measurements beside this package.
"""
