"""The recorder of the machine: it listens to the bus, keeps the last hours, and freezes what is around an exit.

A disk that is full, or gone, costs frames and nothing else: it is said, and tried again with the next one.
"""

from collections.abc import Callable

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.ring import Ring

COMMAND = "PumpCurrentCommand"
SILENCE_S = 0.3  # s without a command, after which the cruise control is gone; the drive gives up after 0.2 s


class BlackBox:
    """A node that only listens; `say` takes lines for the log. An exit is the end of active commands, told or not."""

    period_s = 0.1

    def __init__(self, codec: Codec, ring: Ring, say: Callable[[str], None]) -> None:
        self.codec = codec
        self._say = say
        self.ring = ring
        self.exits = 0
        self.failures = 0  # of writing, since the start
        self.problem = ""  # what the system said of the last one
        self._active = False
        self._command_s = 0.0
        self._now_s = 0.0

    def receive(self, frame: Frame) -> None:
        """Write one frame down."""
        self._try(lambda: self.ring.write(frame, self._now_s))
        decoded = self.codec.decode(frame)
        if decoded.message != COMMAND or decoded.fault is not None:
            return
        self._command_s = self._now_s
        active = any(reading.name == "command_active" and reading.value == 1.0 for reading in decoded.readings)
        if self._active and not active:
            self._exit()
        self._active = active

    def tick(self, now_s: float) -> list[Frame]:
        """It says nothing."""
        self._now_s = now_s
        if self._active and now_s - self._command_s > SILENCE_S:
            self._active = False
            self._exit()
        return []

    def close(self) -> None:
        """Write down what is left."""
        self._try(self.ring.close)

    def _exit(self) -> None:
        self.exits += 1
        self._try(lambda: self.ring.freeze(self._now_s))

    def _try(self, act: Callable[[], None]) -> None:
        try:
            act()
        except (OSError, ValueError) as error:  # ValueError: a segment that the full disk has closed
            self.failures += 1
            why = error.strerror if isinstance(error, OSError) else error  # whichever segment it is
            problem = f"{self.ring.folder}: cannot be written: {why}"
            if problem != self.problem:  # once, and not with every frame
                self._say(problem)
            self.problem = problem
