"""What the service has heard: the newest reading of every signal, and how the frames that brought them behaved.

A reading counts as stale as soon as it will be at the next tick, so that whoever waits for it acts in time.
"""

import math
from collections import Counter, deque
from collections.abc import Collection
from itertools import takewhile
from typing import Final

from cruise.can.codec import Codec, Decoded
from cruise.can.frame import Frame, FrameFault
from cruise.can.messages import CONTRACTS, FAST_MESSAGE
from cruise.control.situation import WAVERING_MPS
from cruise.sampling import FRESH_S, SamplingSettings
from cruise.service.playback import Playback
from cruise.signals import INPUT, OUTPUT, Reading

RADAR: Final = "radar_speed_mps"  # the ground speed that is not the drive's own
OURS: Final = frozenset(one.name for one in CONTRACTS if one.sender == "cruise")
PROTECTED: Final = frozenset(one.name for one in CONTRACTS if one.own and one.sender != "cruise")
DAMAGED: Final = frozenset({FrameFault.BAD_CRC, FrameFault.COUNTER_REPEATED, FrameFault.COUNTER_JUMPED})
LAST_FRAMES: Final = 10  # of a protected message, over which the share of damaged ones is taken,
LAST_S: Final = 5.0  # s, and how old one of them may be
COUNT_S: Final = 1.0  # s over which the frames of a message are counted
MOST: Final = 1000  # frames that are counted of a message: a flood must not fill the memory
FEW: Final = 1.0  # frame that a count may be off by
SETPOINT: Final = "setpoint_mps"
ENGAGING: Final = frozenset({"cruise_set", "cruise_resume"})
"""Buttons whose change two frames in a row have to report: their message has no checksum. No flipped bit may engage,
neither as a press nor as a release of a button that is still held. Nor may silence: at first, and after it, a button is
unknown until two frames agree, so that one which is held is no press that was seen to begin."""


class Hearing:
    """Takes frames in; everything else is to be read."""

    def __init__(self, codec: Codec, sampling: SamplingSettings, period_s: float) -> None:
        self.codec = codec
        self.sampling = sampling
        self.period_s = period_s
        self.latest: dict[str, tuple[float, float]] = {}
        self.faults: Counter[str] = Counter()
        self.imposters = 0  # intact frames of our own messages, since the operator switched on
        # Of the last frames of each protected message when it came, where it was damaged.
        self.damaged: dict[str, deque[float]] = {name: deque(maxlen=LAST_FRAMES) for name in PROTECTED}
        self.playback = Playback()  # of the drive's message
        self.arrivals: dict[str, deque[float]] = {}
        self.since_s: dict[str, float] = {}  # when each message came first, or after a pause
        self.pressed = dict.fromkeys(ENGAGING, math.nan)  # as the last frame has it
        self.words: deque[float] = deque(maxlen=3)  # the last setpoints
        self.wavered: deque[float] = deque(maxlen=MOST)  # when the setpoint went back to the one before
        self.usual: dict[str, int] = {}  # frames of each message in its first second to compare with, in this drive

    def take(self, frame: Frame, ignored: Collection[str] = ()) -> list[Reading]:
        """Take one frame in, whatever it is; return its readings; speed and current are the drive's own."""
        decoded = self.codec.decode(frame)
        if decoded.fault is not None:
            self.faults[str(decoded.fault)] += 1
        if decoded.message is not None:
            self._note(decoded.message, decoded, frame.timestamp)
        if decoded.message == FAST_MESSAGE and decoded.fault is None:
            self.playback.take(tuple([reading.value for reading in decoded.readings]))
        kept = []
        for reading in decoded.readings:
            if reading.name in ignored:
                continue
            if reading.name == SETPOINT:
                self._hear_word(reading)
            if reading.name == OUTPUT and decoded.message != FAST_MESSAGE:
                self.latest[RADAR] = (reading.time_s, reading.value)
            elif reading.name in ENGAGING:
                time_s, held = self.latest.get(reading.name, (-math.inf, math.nan))
                before = self.pressed[reading.name]
                if reading.time_s - time_s > self.sampling.stale_after(reading.name):
                    held = before = math.nan
                sure = reading.value == before or (math.isnan(reading.value) and math.isnan(before))
                self.latest[reading.name] = (reading.time_s, reading.value if sure else held)
                self.pressed[reading.name] = reading.value
                kept.append(reading)
            elif reading.name != INPUT or decoded.message == FAST_MESSAGE:
                self.latest[reading.name] = (reading.time_s, reading.value)
                kept.append(reading)
        return kept

    def take_word(self, reading: Reading) -> None:
        """Take one reading of the operator's in that came another way (CANopen)."""
        self.latest[reading.name] = (reading.time_s, reading.value)
        if reading.name == SETPOINT:
            self._hear_word(reading)

    def value(self, name: str, now_s: float) -> float:
        """The newest value of a signal; NaN where it is stale or was not measured."""
        time_s, value = self.latest.get(name, (-math.inf, math.nan))
        return value if now_s + self.period_s - time_s <= self.sampling.stale_after(name) + 1e-6 else math.nan

    def compare(self, now_s: float, driving: bool) -> None:
        """Take for usual, while the controller drives, how often a message comes that came for a second without pause.

        Messages that pause between any two frames are too slow for a second sender to stand out.
        """
        if not driving:
            self.usual.clear()
            return
        for name, times_s in self.arrivals.items():
            comes = bool(times_s) and now_s - times_s[-1] <= FRESH_S and now_s - self.since_s[name] >= COUNT_S
            if comes and name not in self.usual:
                self.usual[name] = self._count(name, now_s)

    def crowding(self, now_s: float) -> float:
        """Of the busiest message, its frames in the last second over those that are usual; NaN: none is known."""
        return max((self._count(name, now_s) / (count + FEW) for name, count in self.usual.items()), default=math.nan)

    def wavering(self, now_s: float) -> int:
        """How often in the last second the setpoint went back to the one before: two panels that disagree."""
        return _recent(self.wavered, now_s)

    def faulty_share(self, now_s: float) -> float:
        """Of the last frames of the worst protected message."""
        return max(sum(now_s - at_s <= LAST_S for at_s in frames) for frames in self.damaged.values()) / LAST_FRAMES

    def _note(self, message: str, decoded: Decoded, time_s: float) -> None:
        if message in OURS:
            self.imposters += decoded.fault is None
            return
        if message in self.damaged and decoded.fault is not FrameFault.WRONG_SOURCE:
            self.damaged[message].append(time_s if decoded.fault in DAMAGED else -math.inf)
        if decoded.fault is None:
            times_s = self.arrivals.setdefault(message, deque(maxlen=MOST))
            if not times_s or time_s - times_s[-1] > FRESH_S:
                self.since_s[message] = time_s
            _arrive(times_s, time_s)

    def _hear_word(self, reading: Reading) -> None:
        self.words.append(reading.value)
        if len(self.words) == 3:
            first, other, again = self.words
            if abs(first - other) > WAVERING_MPS and abs(first - again) <= WAVERING_MPS:
                _arrive(self.wavered, reading.time_s)

    def _count(self, message: str, now_s: float) -> int:
        return _recent(self.arrivals[message], now_s)


def _arrive(times_s: deque[float], now_s: float) -> None:
    """One more, and none that is too old to be counted from now on."""
    while times_s and now_s - times_s[0] > COUNT_S:
        times_s.popleft()
    times_s.append(now_s)


def _recent(times_s: deque[float], now_s: float) -> int:
    """How many of the times lie in the last second: all but the first few."""
    return len(times_s) - sum(1 for _ in takewhile(lambda time_s: now_s - time_s > COUNT_S, times_s))
