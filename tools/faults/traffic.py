"""Frames that are lost, late, repeated, forged, damaged or out of order, and nodes that cannot be heard."""

from collections import deque
from collections.abc import Mapping
from random import Random

from cruise.can.frame import Frame

from .bed import CRUISE, INTRUDER, MACHINE, PANEL, Bed, Fault, Wire, codec

NEEDED = (
    "DriveFeedback",
    "EEC1",
    "ETC2",
    "MachineState",
    "CCVS",
    "MachineSelectedSpeedCommand",
)  # without these nothing drives
CAN_ERROR_BUSOFF = 0x40  # linux/can/error.h


class Lost(Fault):
    """A share of the frames of some messages, or of all, never arrives."""

    def __init__(self, rng: Random, share: float, messages: tuple[str, ...] = ()) -> None:
        self.dice, self.share, self.messages = Random(rng.random()), share, messages

    def frame(self, sender: str, message: str, frame: Frame, wire: Wire) -> bool:
        """Dice."""
        return (bool(self.messages) and message not in self.messages) or self.dice.random() >= self.share


class Silent(Fault):
    """Nodes whose frames do not get out, and that hear nobody: bus-off, a broken plug, a short circuit."""

    def __init__(self, *senders: str) -> None:
        self.senders = senders

    def begin(self, bed: Bed) -> None:
        """What the controller of the service says of it."""
        if CRUISE in self.senders:
            bed.node.receive(
                Frame(timestamp=bed.wire.now_s, is_error_frame=True, arbitration_id=CAN_ERROR_BUSOFF, data=bytes(8))
            )

    def frame(self, sender: str, message: str, frame: Frame, wire: Wire) -> bool:
        """Past the nodes that are cut off."""
        if sender not in self.senders:
            for name, waiting in wire.waiting.items():
                if name != sender and name not in self.senders:
                    waiting.append(frame)
            if sender == CRUISE:
                wire.heard(sender, frame)
        return False


class Late(Fault):
    """Frames arrive later, each by its own time; out of order where that differs."""

    def __init__(self, rng: Random, low_s: float, high_s: float, messages: tuple[str, ...] = ()) -> None:
        self.dice, self.low_s, self.high_s, self.messages = Random(rng.random()), low_s, high_s, messages

    def frame(self, sender: str, message: str, frame: Frame, wire: Wire) -> bool:
        """Into the queue."""
        if self.messages and message not in self.messages:
            return True
        late_s = self.dice.uniform(self.low_s, self.high_s)
        wire.put(sender, frame, late_s)
        return False


class Repeated(Fault):
    """Every frame comes again, so much later."""

    def __init__(self, late_s: float) -> None:
        self.late_s = late_s

    def frame(self, sender: str, message: str, frame: Frame, wire: Wire) -> bool:
        """And again."""
        wire.put(sender, frame, self.late_s)
        return True


class Swapped(Fault):
    """Two frames of a message in a row come in the wrong order, again and again."""

    def __init__(self, *messages: str) -> None:
        self.messages = messages
        self.held: dict[str, Frame] = {}

    def frame(self, sender: str, message: str, frame: Frame, wire: Wire) -> bool:
        """The first waits for the second."""
        if message not in self.messages:
            return True
        first = self.held.pop(message, None)
        if first is None:
            self.held[message] = frame
            return False
        wire.put(sender, frame)
        first.timestamp = frame.timestamp
        wire.put(sender, first)
        return False


class Damaged(Fault):
    """Bits flip in a share of the frames, or their end is cut off."""

    def __init__(self, rng: Random, share: float, cut: bool = False, messages: tuple[str, ...] = ()) -> None:
        self.dice, self.share, self.cut, self.messages = Random(rng.random()), share, cut, messages

    def frame(self, sender: str, message: str, frame: Frame, wire: Wire) -> bool:
        """Dice, then harm."""
        if (self.messages and message not in self.messages) or self.dice.random() >= self.share:
            return True
        if self.cut:
            frame.data = frame.data[: self.dice.randrange(8)]
            frame.dlc = len(frame.data)
            return True
        for _ in range(self.dice.randint(1, 3)):
            frame.data[self.dice.randrange(8)] ^= 1 << self.dice.randrange(8)
        return True


class Babbling(Fault):
    """A node that shouts: strange frames in plenty, and for the others only a share of the bus."""

    def __init__(self, rng: Random, left: float) -> None:
        self.dice, self.left = Random(rng.random()), left

    def frame(self, sender: str, message: str, frame: Frame, wire: Wire) -> bool:
        """Three frames of noise for one that was sent, which may get through, late."""
        for _ in range(3):
            noise = Frame(wire.now_s, self.dice.getrandbits(29), data=self.dice.randbytes(self.dice.randrange(9)))
            wire.put(INTRUDER, noise)
        if self.dice.random() < self.left:
            wire.put(sender, frame, self.dice.uniform(0.0, 0.05))
        return False


class Forged(Fault):
    """A stranger sends a message of another, right after the true one; `intact` where he knows how to protect it.

    `alone`: the true sender is silenced.
    """

    def __init__(self, message: str, values: Mapping[str, float], intact: bool = True, alone: bool = False) -> None:
        self.message, self.values, self.intact, self.alone = message, values, intact, alone
        self.voice = codec()

    def frame(self, sender: str, message: str, frame: Frame, wire: Wire) -> bool:
        """The lie beside the truth."""
        if message != self.message:
            return True
        forged = self.voice.encode(message, self.values, frame.timestamp)
        if not self.intact:
            forged.data[0] ^= 0x5A
        if not self.alone:
            wire.put(sender, frame)
        wire.put(INTRUDER, forged)
        return False


class Stranger(Forged):
    """A message of ours from an address that is not its sender's."""

    def frame(self, sender: str, message: str, frame: Frame, wire: Wire) -> bool:
        """The lie beside the truth, under the stranger's own address."""
        if message == self.message:
            forged = self.voice.encode(message, self.values, frame.timestamp)
            forged.arbitration_id = forged.arbitration_id & ~0xFF | 0xFD
            wire.put(INTRUDER, forged)
        return True


class Replayed(Fault):
    """What machine and panel sent a while ago comes instead of what they send now."""

    def __init__(self, ago: int) -> None:
        self.ago = ago  # frames
        self.past: dict[str, deque[Frame]] = {}

    def frame(self, sender: str, message: str, frame: Frame, wire: Wire) -> bool:
        """The first `ago` of each message are kept and played over and over."""
        if sender not in (MACHINE, PANEL):
            return True
        past = self.past.setdefault(message, deque())
        if len(past) < self.ago:
            past.append(frame)
            return True
        old = past.popleft()
        past.append(old)
        old.timestamp = frame.timestamp
        wire.put(sender, old)
        return False
