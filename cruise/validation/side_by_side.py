"""The same work on many items, on all cores: in children of this process, which have all that it has.

A child is forked, so that no recording is copied and only results travel. Where this process may have no children of
its own, or nothing can be forked, the work is done here, one after the other; the results are the same.
"""

import ctypes
import multiprocessing
import os
import signal
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Final, TypeVar

from threadpoolctl import threadpool_limits

DIES_WITH_PARENT: Final = 1  # PR_SET_PDEATHSIG of prctl(2)

Item = TypeVar("Item")
Result = TypeVar("Result")

_begun: list[tuple[Callable[[Any], Any], Sequence[Any]]] = []  # what children find when they are forked


def side_by_side(work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """`work` of every item, in their order. An error of the first item that has one is raised here."""
    workers = min(len(os.sched_getaffinity(0)), len(items)) if hasattr(os, "fork") else 1
    if workers < 2 or multiprocessing.current_process().daemon:
        yield from map(work, items)
        return
    _begun.append((work, items))
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("fork"), _child, (os.getpid(),))
    try:
        with warnings.catch_warnings():  # other threads of this process hold nothing that a child needs
            warnings.simplefilter("ignore", DeprecationWarning)
            results = pool.map(_one, range(len(items)))
        yield from results
    finally:
        pool.shutdown(cancel_futures=True)
        _begun.pop()


def _child(parent: int) -> None:
    """Alone on its core, deaf to Ctrl-C, which is for the parent to answer, and gone with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(1)
    ctypes.CDLL(None).prctl(DIES_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def _one(place: int) -> Any:
    work, items = _begun[-1]
    return work(items[place])
