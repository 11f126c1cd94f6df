"""A program that takes 80 MB and half a second at least in one function, and prints what is seen of it."""

from __future__ import annotations

import json
import time

import numpy as np

from benchmarks.speed.sampled import Stacks


def hold() -> np.ndarray:
    began, held = time.perf_counter(), np.ones(10_000_000)
    took = time.perf_counter() - began  # up to a second where memory is slow to come: it must not be most of the time
    while time.perf_counter() < began + 3.0 * took + 0.5:
        pass
    return held


if __name__ == "__main__":
    stacks = Stacks()
    stacks.start()
    while not stacks.seconds:  # memory that is taken before the first look is seen by none
        pass
    hold()
    stacks.ended.set()
    stacks.join()
    print(json.dumps([stacks.most(stacks.seconds), stacks.grown_mb]))
