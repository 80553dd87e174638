"""Long work in a process of its own: it says what it does, hands over what is there already, and can be stopped."""

import multiprocessing
import os
import traceback
from collections.abc import Callable, Sequence
from multiprocessing import forkserver
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
        self._process = CONTEXT.Process(target=_run, args=(sender, function, arguments, expected), daemon=True)
        self._process.start()
        sender.close()

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
        self._process.join()
        self._process.close()
        self._receiver.close()


def _run(
    sender: Any, function: Callable[..., Any], arguments: tuple[Any, ...], expected: tuple[type[Exception], ...]
) -> None:
    def show(text: str, part: object = None) -> None:
        if part is not None:
            sender.send((PART, part))
        sender.send((SAID, text))

    os.nice(NICER)
    try:
        sender.send((DONE, function(*arguments, show)))
    except expected as error:
        sender.send((REFUSED, str(error)))
    except Exception:  # noqa: BLE001  # a bug: nobody sees the standard error of this process
        sender.send((BROKEN, traceback.format_exc()))
