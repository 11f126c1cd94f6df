"""A program that takes 80 MB and half a second in one function, and prints what is seen of it."""

from __future__ import annotations

import json
import time

import numpy as np

from benchmarks.speed.sampled import Stacks


def hold() -> np.ndarray:
    until, held = time.perf_counter() + 0.5, np.ones(10_000_000)
    while time.perf_counter() < until:
        pass
    return held


if __name__ == "__main__":
    stacks = Stacks()
    stacks.start()
    hold()
    stacks.ended.set()
    stacks.join()
    print(json.dumps([stacks.most(stacks.seconds), stacks.grown_mb]))
