"""What the service tells systemd: that it is ready, that it is alive, what it does. Without systemd it tells nobody.

Source: sd_notify(3): datagrams of VARIABLE=VALUE lines to the AF_UNIX socket that NOTIFY_SOCKET names.
"""

import contextlib
import os
import socket
from collections.abc import Mapping
from typing import Self

RELOAD_S = 10.0  # s that the end of a run, or a reload, may take before the watchdog ends it
WATCHDOG_SHARE = 0.25  # of the time that systemd allows between two signs of life


class Notifier:
    """Tells systemd; `alive` may be called as often as one likes."""

    def __init__(self, address: str, watchdog_s: float = 0.0) -> None:
        self._address = f"\0{address[1:]}" if address.startswith("@") else address
        self._watchdog_s = watchdog_s
        self._every_s = WATCHDOG_SHARE * watchdog_s
        self._next_s = 0.0

    @classmethod
    def of(cls, environment: Mapping[str, str] = os.environ) -> Self:
        """Take address and watchdog from what systemd has set for this process."""
        ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        watchdog_us = int(environment.get("WATCHDOG_USEC", "0")) if ours else 0
        return cls(environment.get("NOTIFY_SOCKET", ""), 1e-6 * watchdog_us)

    @property
    def listened_to(self) -> bool:
        """Whether systemd has started the service."""
        return bool(self._address)

    def tell(self, *lines: str) -> None:
        """Tell systemd: "READY=1", "STOPPING=1", "STATUS=engaged", ..."""
        if not self._address:
            return
        kind = socket.SOCK_DGRAM | socket.SOCK_NONBLOCK
        # A full or missing socket must not end a drive; where nobody is told any more, the watchdog does.
        with socket.socket(socket.AF_UNIX, kind) as systemd, contextlib.suppress(OSError):
            systemd.sendto("\n".join(lines).encode(), self._address)

    def ready(self) -> None:
        """It serves from now on."""
        self.tell("READY=1", *self._watch(self._watchdog_s))
        self._next_s = 0.0  # a loop begins with a clock of its own

    def ended(self) -> None:
        """Its loop has ended: the watchdog waits until what is kept has been written, however slow the disk is."""
        self.tell("STATUS=writing down what is kept", *self._watch(RELOAD_S))

    def reloading(self) -> None:
        """It reads its settings again: the watchdog waits until it is ready."""
        self.tell("STATUS=reading the settings again", *self._watch(RELOAD_S))

    def _watch(self, within_s: float) -> list[str]:
        return [f"WATCHDOG_USEC={round(1e6 * within_s)}"] if self._watchdog_s > 0.0 else []

    def alive(self, now_s: float) -> None:
        """Feed the watchdog, if it is time to."""
        if self._every_s > 0.0 and now_s >= self._next_s:
            self._next_s = now_s + self._every_s
            self.tell("WATCHDOG=1")
