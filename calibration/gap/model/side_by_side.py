"""Calls that depend on nothing but their arguments, on several threads at a time.

What is compiled runs outside Python's lock. The result is that of one thread, to the last bit.
"""

from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def side_by_side(
    call: Callable[[Item], Result], items: Iterable[Item], threads: int
) -> list[Result]:
    """`call` of each item, in their order, on at most `threads` threads, this one included.

    Others help where they are free, so a call may come here in its turn. The first exception of a
    call is raised.
    """
    items = list(items)
    if threads == 1 or len(items) < 2:
        return [call(item) for item in items]
    found: dict[int, Result] = {}
    left = deque(enumerate(items))

    def work() -> None:
        while True:
            try:
                i, item = left.popleft()
            except IndexError:
                return
            found[i] = call(item)

    pool = _pool(threads - 1)
    helping = [pool.submit(work) for _ in range(min(threads, len(items)) - 1)]
    try:
        work()
    finally:
        left.clear()
        begun = [one for one in helping if not one.cancel()]
    for one in begun:
        one.result()
    return [found[i] for i in range(len(items))]


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """The threads of all calls: to start some for every few would take as long as these."""
    return ThreadPoolExecutor(threads, "prediction")
