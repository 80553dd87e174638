"""What the canopen library sends, without a bus and without its threads: collected, and due by a time that is given."""

import math
from typing import Final

import canopen
from canopen.network import PeriodicMessageTask

ROUNDING_S: Final = 1e-6  # s, what sums of periods may be off; a tick is not left out for it


class _Task(PeriodicMessageTask):
    """A message that the library wants sent periodically; `Network.tick` does it instead of a thread."""

    def _start(self) -> None:
        self.next_s = -math.inf
        self.running = True

    def stop(self) -> None:
        self.running = False

    def update(self, data: bytes) -> None:
        self.msg.data = bytearray(data)


class Network(canopen.Network):
    """The library's network without a bus: what it sends is collected in `outbox`, identifier and data."""

    def __init__(self) -> None:
        super().__init__()
        self.outbox: list[tuple[int, bytes]] = []
        self.tasks: list[_Task] = []

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self.outbox.append((can_id, bytes(data)))

    def send_periodic(self, can_id: int, data: bytes, period: float, remote: bool = False) -> PeriodicMessageTask:
        task = _Task(can_id, data, period, None, remote)
        self.tasks.append(task)
        return task

    def tick(self, now_s: float) -> None:
        """Send what is due."""
        self.tasks = [task for task in self.tasks if task.running]
        for task in self.tasks:
            if is_due(task.next_s, now_s):
                task.next_s = next_due(task.next_s, task.period, now_s)
                self.send_message(task.msg.arbitration_id, bytes(task.msg.data))


def is_due(due_s: float, now_s: float) -> bool:
    """Whether it is time to."""
    return now_s >= due_s - ROUNDING_S


def next_due(due_s: float, period_s: float, now_s: float) -> float:
    """Return when a message is due again: in step, or from now on where a whole period was missed."""
    return due_s + period_s if due_s + period_s > now_s else now_s + period_s
