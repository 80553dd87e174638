"""`cruise workbench`: the walk from a recording to the missing effect, in the browser."""

import os
import secrets
import socket
from pathlib import Path
from typing import Annotated
from urllib.parse import quote

import typer

from cruise.cli.places import CONFIG
from cruise.cli.reading import Columns, Database, Horizon, InputName, OutputName, above_zero, columns_of
from cruise.identification.named import model_named
from cruise.recording import RecordingError
from cruise.service import settings as service_settings
from cruise.settings import SettingsError
from cruise.workbench.guard import HERE


def workbench(
    recordings: Annotated[list[Path] | None, typer.Argument(help="Opened at once.", show_default=False)] = None,
    model: Annotated[str | None, typer.Option(help="Name, structure written out, or model file to compare.")] = None,
    columns: Columns = None,
    input_name: InputName = None,
    output_name: OutputName = None,
    database: Database = None,
    horizon: Horizon = 3.0,
    live: Annotated[Path | None, typer.Option(help="Settings of the service whose bus is listened to.")] = None,
    host: Annotated[str, typer.Option(help="Address to serve on; others than this machine need the token.")] = HERE[0],
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to serve on.")] = 8080,
    browser: Annotated[bool, typer.Option(help="Open the browser.")] = True,
) -> None:
    """Compare, find what is missing, add it and take the model away, in the browser."""
    try:
        from cruise.workbench import app
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("cruise"):
            raise
        raise SettingsError(
            f"workbench: {error.name} is not installed; run pip install '.[workbench]' in the checkout"
        ) from error
    from cruise.workbench.found import Question, Source
    from cruise.workbench.session import MODEL, Session, Step
    from cruise.workbench.setup import Setup

    for path in recordings or []:
        if not path.is_file():
            raise RecordingError(f"{path}: no such file")
    if model is not None:
        model_named(model)
    if live is not None:
        service_settings.load(live)
    reading = columns_of(columns, input_name, output_name, database)
    question = Question(model or MODEL, horizon_s=above_zero("--horizon", horizon))

    def begin(session: Session) -> None:
        session.steps = [Step(Path(question.model).name, question)]
        if recordings:
            title = recordings[0].name if len(recordings) == 1 else f"{len(recordings)} recordings"
            session.open(Source(tuple(path.absolute() for path in recordings), reading, title))

    token = "" if host in HERE else os.environ.get("CRUISE_TOKEN") or secrets.token_urlsafe(16)
    address = f"http://{_authority(host, port)}/" + (f"?token={quote(token, safe='')}" if token else "")
    _free(host, port)
    print(f"cruise: workbench on {address}", flush=True)
    app.serve(
        app.Workbench(Setup(reading, CONFIG, user_cache(), live), begin), host, port, token, show=browser and not token
    )


def _free(host: str, port: int) -> None:
    """SettingsError where nothing can be served there."""
    try:
        with socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET):
            pass
    except OSError as error:
        raise SettingsError(
            f"workbench: {_authority(host, port)}: {error.strerror}; give another with --port"
        ) from error


def _authority(host: str, port: int) -> str:
    """Host and port as they stand in an address: that of IPv6 in brackets (RFC 3986, section 3.2.2)."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def user_cache() -> Path:
    """Where this user's caches are (XDG Base Directory Specification)."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cruise"
