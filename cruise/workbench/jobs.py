"""Long work in a process of its own: it says what it does, hands over what is there already, and can be stopped.

It works on all cores where it can, so it is no daemon, which may have no children; still it ends with the server.
"""

import atexit
import multiprocessing
import os
import traceback
from collections.abc import Callable, Sequence
from multiprocessing import connection, forkserver
from threading import Thread
from typing import Any, Final

SAID, PART, DONE, REFUSED, BROKEN = "said", "part", "done", "refused", "broken"
CONTEXT: Final = multiprocessing.get_context("forkserver")  # a child of its own kind: this process has threads
NICER: Final = 10  # steps in which the work stands behind the page, so that the page still answers on a single core
LOST: Final = "the computation ended without a word; the machine may be out of memory"


def prepare(modules: Sequence[str]) -> None:
    """Let the process from which the work is forked import these once, so that no work waits for it."""
    CONTEXT.set_forkserver_preload(list(modules))
    forkserver.ensure_running()


class Job:
    """`function(*arguments, show)` in a process. Errors of the kinds `expected` are said to the user as they are."""

    def __init__(
        self,
        title: str,
        function: Callable[..., Any],
        arguments: tuple[Any, ...],
        expected: tuple[type[Exception], ...],
    ) -> None:
        self.title = title
        self.told: list[str] = []
        self.part: Any = None
        self.result: Any = None
        self.fault = ""  # why there is no result
        self.cancelled = False
        self.running = True
        self._receiver, sender = CONTEXT.Pipe(duplex=False)
        self._process = CONTEXT.Process(target=_run, args=(sender, function, arguments, expected))
        self._process.start()
        sender.close()
        RUNNING.add(self)

    def poll(self) -> bool:
        """Take in what was said; whether anything was."""
        heard = False
        while self.running and self._receiver.poll():
            heard = True
            try:
                kind, value = self._receiver.recv()
            except (EOFError, OSError):
                kind, value = BROKEN, LOST
            if kind == SAID:
                self.told.append(value)
            elif kind == PART:
                self.part = value
            else:
                self.result, self.fault = (value, "") if kind == DONE else (None, value)
                self._end()
        return heard

    def cancel(self) -> None:
        """Stop the work at once; there is no result."""
        if self.running:
            self.cancelled, self.fault = True, "stopped"
            self._process.kill()
            self._end()

    def _end(self) -> None:
        self.running = False
        RUNNING.discard(self)
        self._process.join()
        self._process.close()
        self._receiver.close()


RUNNING: Final[set[Job]] = set()


@atexit.register
def _stop() -> None:
    """No work is waited for when the server ends."""
    for job in list(RUNNING):
        job.cancel()


def _end_with_server() -> None:
    """Wait until the server is gone, however it ended; then nobody wants to know."""
    server = multiprocessing.parent_process()
    assert server is not None
    connection.wait([server.sentinel])
    os._exit(1)


def _run(
    sender: Any, function: Callable[..., Any], arguments: tuple[Any, ...], expected: tuple[type[Exception], ...]
) -> None:
    def show(text: str, part: object = None) -> None:
        if part is not None:
            sender.send((PART, part))
        sender.send((SAID, text))

    Thread(target=_end_with_server, daemon=True).start()
    os.nice(NICER)
    try:
        sender.send((DONE, function(*arguments, show)))
    except expected as error:
        sender.send((REFUSED, str(error)))
    except Exception:  # noqa: BLE001  # a bug: nobody sees the standard error of this process
        sender.send((BROKEN, traceback.format_exc()))
