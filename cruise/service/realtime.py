"""What keeps a loop on time that its computer gives it: memory that stays, garbage that is collected when it suits.

Sources: mlockall(2), Linux 4.4 (MCL_ONFAULT); Python's gc module.
"""

import ctypes
import gc
import resource
from typing import Final

MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
COLLECT_S: Final = 1.0  # s between two collections of what is young


class Garbage:
    """Takes the collection of garbage in hand: what is there now is never looked at again, the young once a second."""

    def __init__(self) -> None:
        self._next_s = 0.0
        gc.collect()
        gc.freeze()
        gc.disable()

    def step(self, now_s: float) -> None:
        """Collect, if it is time to; to be called after a tick, when the time until the next one is longest."""
        if now_s >= self._next_s:
            self._next_s = now_s + COLLECT_S
            gc.collect(1)

    def close(self) -> None:
        """Leave it to Python again."""
        gc.enable()
        gc.unfreeze()


def lock_memory() -> bool:
    """Keep every page of this process in memory once it is there; False where the limit (LimitMEMLOCK) forbids it."""
    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] != resource.RLIM_INFINITY:
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    return libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0
