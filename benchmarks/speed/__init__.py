"""Speed against peers: `BENCHMARKS` is the only list; adding one is a file beside this and a line here."""

from __future__ import annotations

from benchmarks.speed import (
    frequency_response,
    full_bench,
    help_text,
    linear_simulation,
    log_commands,
    long_log,
    new_process,
    nonlinear_loop,
    one_diagnosis,
    paper_report,
    rational_fit,
    thermal_test,
)
from benchmarks.speed.base import Benchmark

BENCHMARKS: tuple[Benchmark, ...] = (
    full_bench.BENCHMARK,
    new_process.BENCHMARK,
    nonlinear_loop.BENCHMARK,
    linear_simulation.BENCHMARK,
    frequency_response.BENCHMARK,
    rational_fit.BENCHMARK,
    thermal_test.BENCHMARK,
    paper_report.BENCHMARK,
    help_text.BENCHMARK,
    long_log.BENCHMARK,
    log_commands.BENCHMARK,
    one_diagnosis.BENCHMARK,
)

__all__ = ["BENCHMARKS"]
