"""The workbench as it is used: served by the verb itself, walked through in a real browser."""

import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.error import URLError

import pytest

ROOT = Path(__file__).parents[2]
STARTS_S = 120.0  # until the page answers, on a machine that does other things too


@pytest.fixture(scope="session")
def cache(tmp_path_factory) -> Path:
    """Where the bundled recordings are kept while the tests run."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="session")
def server(cache, tmp_path_factory) -> Iterator[str]:
    """Address of a workbench that runs as `cruise workbench` starts it."""
    pytest.importorskip("nicegui", reason="the extra workbench is not installed")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    words = ["cruise", "workbench", "--no-browser", "--port", str(port)]
    # Less than the tests themselves have: nothing of pytest, and of its warnings, in the server.
    env = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "NICEGUI"))}
    env |= {"XDG_CACHE_HOME": str(cache), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
    said = tmp_path_factory.mktemp("server") / "said.txt"
    with said.open("w") as stream:
        process = subprocess.Popen(
            [sys.executable, "-c", f"import sys; sys.argv = {words!r}; from cruise.cli import main; main()"],
            cwd=ROOT,
            env=env,
            stdout=stream,
            stderr=subprocess.STDOUT,
        )
        address = f"http://127.0.0.1:{port}"
        try:
            _wait(address, process, said)
            yield address
        finally:
            process.terminate()
            process.wait(30)
    assert "Traceback" not in said.read_text(), said.read_text()


def _wait(address: str, process: subprocess.Popen, said: Path) -> None:
    until = time.monotonic() + STARTS_S
    while time.monotonic() < until:
        assert process.poll() is None, said.read_text()
        try:
            with urllib.request.urlopen(address, timeout=5):
                return
        except (URLError, OSError):
            time.sleep(0.2)
    pytest.fail(f"no answer from {address}: {said.read_text()}")


@pytest.fixture(scope="session")
def chromium() -> Iterator[object]:
    """A headless Chromium; without one the walk is not run, and says so."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: no walk in a browser")
    found = subprocess.run([ROOT / "tools" / "browser"], capture_output=True, text=True)
    if found.returncode:
        pytest.skip(f"no walk in a browser: {found.stderr.strip()}")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=found.stdout.strip().splitlines()[-1], args=["--no-sandbox", "--disable-gpu"]
        )
        yield browser
        browser.close()


@pytest.fixture
def visit(chromium, server) -> Iterator[Callable[[], object]]:
    """Opens the page in a browser of its own: another visitor each time. Nothing may go wrong in any of them."""
    contexts, errors, elsewhere = [], [], []

    def come():
        context = chromium.new_context(viewport={"width": 1440, "height": 900}, accept_downloads=True)
        context.set_default_timeout(90_000)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        page.on("request", lambda one: elsewhere.append(one.url) if not _ours(one.url, server) else None)
        page.goto(server)
        page.get_by_text("Your own").wait_for()
        return page

    yield come
    for context in contexts:
        context.close()
    assert errors == []
    assert elsewhere == [], "something was requested from another host"


def _ours(url: str, server: str) -> bool:
    return url.startswith((server, server.replace("http:", "ws:"), "data:", "blob:"))
