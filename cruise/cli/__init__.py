"""The command line: one verb a file, each thin. `main` is the entry point."""

import errno
import sys
from importlib import import_module
from importlib.metadata import version
from typing import Annotated

STOPPED = 130  # exit code of what Ctrl-C ended, as shells have it
DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # what is wrong with a disk, whichever file it is
VERBS = (
    "demo", "run", "plant", "record", "replay", "experiment", "explore", "identify", "orders", "paper", "effects",
    "compare", "diagnose", "add", "ladder", "workbench",
)  # fmt: skip
"""Every verb is the function of its name in the module of its name, imported when it is called for: start-up counts."""


def main() -> None:
    """Run one verb; mistakes of the user end with one clear line and exit code 2, Ctrl-C with no word at any time."""
    try:
        _run()
    except KeyboardInterrupt:
        sys.exit(STOPPED)


def _say_version(asked: bool) -> None:
    if asked:
        print(f"cruise {version('cruise-control-combine')}")
        raise SystemExit


def _run() -> None:
    # Imported here: these pull in the settings, and Ctrl-C may come while they do.
    import typer

    from cruise.can.bus import BusLostError
    from cruise.can.log import LogError
    from cruise.identification.regressors import FitError
    from cruise.recording import RecordingError
    from cruise.settings import SettingsError

    app = typer.Typer(
        help="Cruise control for combine harvesters: learn the drive while driving, drive with what was learned.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    wanted = next((word for word in sys.argv[1:] if word in VERBS), None)
    for verb in VERBS if wanted is None else (wanted,):
        app.command(verb)(getattr(import_module(f"cruise.cli.{verb}"), verb))

    @app.callback()  # without one, a verb that is registered alone would be the whole program
    def program(
        version: Annotated[
            bool, typer.Option("--version", is_eager=True, callback=_say_version, help="Print it and end.")
        ] = False,
    ) -> None:
        pass

    try:
        app()
    except (SettingsError, RecordingError, LogError, FitError) as error:
        print(f"cruise: {error}", file=sys.stderr)
        sys.exit(2)
    except OSError as error:
        if error.filename is None and error.errno not in DISK:  # not about a file of the user's
            raise
        print(f"cruise: {error.filename or wanted}: {error.strerror}", file=sys.stderr)
        sys.exit(2)
    except BusLostError as error:
        print(f"cruise: {error}", file=sys.stderr)
        sys.exit(3)
