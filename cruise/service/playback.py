"""Whether what is heard was heard before: the frames of a living sensor never come twice in the same order.

Played back traffic is intact and in time, and its counters jump once in a round: only its content gives it away. Noise
makes two frames equal now and then, but hardly two dozen in a row in the order of an earlier stretch. At rest all are
equal: a stretch counts only where it holds several that differ.
"""

from collections import deque
from collections.abc import Hashable
from itertools import islice
from typing import Final

ROUND: Final = 64  # frames, the longest round that is looked for: 1.3 s at 50 Hz
DIFFERENT: Final = 4  # frames that differ, at least, in a stretch that counts


class Playback:
    """Of one message."""

    def __init__(self) -> None:
        self.past: deque[Hashable] = deque(maxlen=ROUND)  # newest first
        self.runs = [0] * ROUND  # frames in a row that are those of so many frames before

    def take(self, content: Hashable) -> None:
        """One frame, without its counter and checksum."""
        runs = [run + 1 if content == before else 0 for run, before in zip(self.runs, self.past, strict=False)]
        self.runs = runs + [0] * (ROUND - len(runs))
        self.past.appendleft(content)

    @property
    def repeated(self) -> int:
        """How many of the last frames repeat an earlier stretch; 0 for fewer than differ in what counts."""
        longest = max(self.runs)
        return longest if len(set(islice(self.past, longest))) >= DIFFERENT else 0
