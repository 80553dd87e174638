"""What a row of the table of faults says."""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Final

from .bed import Fault

NONE: Final = "none: harm is bounded by limits"
TIME_OUT: Final = "time-out"
THREE: Final = "wheel and ground speed"
MODEL: Final = "the model's prediction"
COMMAND: Final = "measured against commanded current"
COUNTER: Final = "alive counter and CRC"
RATE: Final = "rate of the message"
OWN: Final = "only one may send it"


@dataclass(frozen=True)
class FaultRow:
    """One fault.

    `silences`: the message whose time-out has to act. `bounded`: nothing can tell it from the truth, so that only
    acceleration and rate are bounded. `from_start`: there when the service starts. `lasting`: it never goes by itself.
    """

    name: str
    does: str
    redundancy: str
    make: Callable[[Random], Fault]
    silences: str = ""
    bounded: bool = False
    from_start: bool = False
    lasting: bool = False
