"""Speed against peers: `BENCHMARKS` is the only list; adding one is a file beside this and a line here."""

from __future__ import annotations

from benchmarks.speed import frequency_response, linear_simulation, nonlinear_loop, rational_fit
from benchmarks.speed.base import Benchmark

BENCHMARKS: tuple[Benchmark, ...] = (
    nonlinear_loop.BENCHMARK,
    linear_simulation.BENCHMARK,
    frequency_response.BENCHMARK,
    rational_fit.BENCHMARK,
)

__all__ = ["BENCHMARKS"]
