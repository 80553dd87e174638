"""`cruise run`: the service on a bus."""

import errno
import signal
import sys
import threading
from pathlib import Path
from typing import Annotated, Final, TextIO

import typer

from cruise.cli.places import CONFIG
from cruise.service import settings as service_settings
from cruise.service.cruise_node import CruiseNode
from cruise.service.daemon import Daemon
from cruise.service.notify import Notifier
from cruise.settings import SettingsError

_FULL: Final = {errno.ENOSPC, errno.EDQUOT}


class Running:
    """True until a signal asks to stop, or a signal or the bus to read the settings again (SIGHUP, `reload`)."""

    def __init__(self) -> None:
        self.stopped = self.reload = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._stop)
        signal.signal(signal.SIGHUP, self._reload)

    def _stop(self, number: int, frame: object) -> None:
        self.stopped = True

    def _reload(self, number: int, frame: object) -> None:
        self.again()

    def again(self) -> None:
        """Have the settings read again."""
        self.reload = True

    def __call__(self) -> bool:
        """Whether to go on."""
        return not (self.stopped or self.reload)


class Rereading:
    """SIGHUP, for a service that drives: the files are read while it drives on, and only good ones end the run.

    To be called with every tick. They are read in a thread: the loop has no time for it.
    """

    def __init__(self, config: Path, running: Running) -> None:
        self._config, self._running = config, running
        self._asked = False
        self._thread: threading.Thread | None = None
        self._wrong = ""
        signal.signal(signal.SIGHUP, self._ask)

    def __call__(self, now_s: float) -> None:
        """Begin to read, or say what came of it."""
        thread = self._thread
        if thread is not None and not thread.is_alive():
            self._thread = None
            if self._wrong:
                say(f"the settings stay as they were: {self._wrong}")
            else:
                self._running.again()
        if self._asked and self._thread is None and not self._running.reload:
            self._asked = False
            self._thread = threading.Thread(target=self._read, name="rereading", daemon=True)
            self._thread.start()

    def _ask(self, number: int, frame: object) -> None:
        self._asked = True

    def _read(self) -> None:
        self._wrong = "reading them failed"  # as it stays where something is raised that nobody expects
        try:
            CruiseNode.load(service_settings.load(self._config))
            self._wrong = ""
        except SettingsError as error:
            self._wrong = str(error)


def run(
    config: Annotated[Path, typer.Argument(help="Settings of the service.")] = CONFIG / "cruise.yaml",
    quiet: Annotated[bool, typer.Option(help="No line of status every 10 s.")] = False,
    check: Annotated[bool, typer.Option("--check", help="Read settings, model and database only, and say so.")] = False,
) -> None:
    """Run the cruise control on the bus until it is stopped; the last command is neutral. SIGHUP reads the settings."""
    settings = service_settings.load(config)
    if check:
        write(f"{config}: {in_words(CruiseNode.load(settings))}", sys.stdout)
        return
    running, notifier = Running(), Notifier.of()
    rereading = Rereading(config, running)
    daemon = Daemon(settings, notifier, say, reload=running.again)
    while True:
        can = daemon.settings.can
        write(f"cruise: on {can.bus} {can.channel}, command every {daemon.node.period_s} s", sys.stdout)
        lines = None if quiet else Lines(daemon.node)

        def each_tick(now_s: float, lines: Lines | None = lines) -> None:
            rereading(now_s)
            if lines is not None:
                lines(now_s)

        daemon.run(running, each_tick)
        lateness = daemon.lateness
        write(
            f"cruise: stopped, neutral sent; ticks late by p50 {lateness.quantile_ms(0.5):.1f}, "
            f"p99 {lateness.quantile_ms(0.99):.1f}, max {lateness.worst_ms:.1f} ms; {lateness.missed} left out",
            sys.stderr,
        )
        if running.stopped or not running.reload:
            break
        running.reload = False
        notifier.reloading()
        try:
            daemon = Daemon(service_settings.load(config), notifier, say, daemon.changes, running.again)
        except SettingsError as error:
            say(f"the settings stay as they were: {error}")
            daemon = Daemon(daemon.of_file, notifier, say, daemon.changes, running.again, again=daemon)
    notifier.tell("STOPPING=1")


def in_words(node: CruiseNode) -> str:
    """What a service with these settings would do."""
    can, folder = node.settings.can, node.settings.persistence
    experiments = node.engagement.experiments
    return ", ".join(
        [
            f"good: drives on {can.bus} {can.channel} with a command every {node.period_s:g} s",
            f"by {node.settings.model}",
            f"needs {', '.join(node.needed)}",
            f"keeps what it learns in {folder.folder}" if folder is not None else "keeps nothing of what it learns",
            f"experiments {', '.join(one.name for one in experiments.values())}" if experiments else "no experiments",
        ]
    )


def say(line: str) -> None:
    """Write a line for the log."""
    write(f"cruise: {line}", sys.stderr)


def write(line: str, stream: TextIO) -> None:
    """Write a line. A full disk loses it, and must not end a drive; a stream that nobody reads any more does."""
    try:
        print(line, file=stream, flush=True)
    except OSError as error:
        if error.errno not in _FULL:
            raise


class Lines:
    """A line of status every 10 s, and at once where who drives has changed or a button was refused.

    What has to be known of a drive that is over, the daemon says as well, for the log.
    """

    def __init__(self, node: CruiseNode) -> None:
        self._node = node
        self._next_s = 0.0
        self._told: tuple[str, int, str] = "", 0, ""

    def __call__(self, now_s: float) -> None:
        """Print, if it is time to."""
        engagement = self._node.engagement
        experiment = engagement.experiment
        doing = engagement.state, engagement.refusals, experiment.name if experiment else ""
        if doing == self._told and now_s < self._next_s:
            return
        self._told, self._next_s = doing, now_s + 10.0
        status = self._node.status(now_s)
        driven = f"  experiment {status.experiment}, {status.experiment_left_s:.0f} s left" if status.experiment else ""
        ended = f"  let go: {engagement.ended_by}" if engagement.ended_by else ""
        refused = f"  refused: {status.refused}" if status.refused else ""
        write(
            f"{now_s:8.1f} s  {status.state}  speed {status.speed_mps:.2f} m/s  setpoint {status.setpoint_mps:.2f} m/s"
            f"  gate {status.gate}  missing: {', '.join(status.missing) or 'nothing'}"
            f"{driven}{ended}{refused}",
            sys.stdout,
        )
