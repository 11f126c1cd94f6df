"""The same work on many things, in threads where that pays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import Any, TypeVar

T = TypeVar("T")


def side_by_side(work: Callable[..., T], *of: Iterable[Any], workers: int) -> Iterator[T]:
    """Yield `work` done for each of what the iterables of equal length `of` list, in their order.

    With several `workers` it runs in so many threads, in parallel where compiled code releases the lock; else one by
    one.
    """
    if workers < 2:
        yield from (work(*one) for one in zip(*of, strict=True))
        return
    # how numpy treats an overflow belongs to a context, which a thread does not take over by itself
    tasks = [(copy_context(), one) for one in zip(*of, strict=True)]
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(lambda task: task[0].run(work, *task[1]), tasks)
