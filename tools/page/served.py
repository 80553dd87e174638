"""A workbench as `cruise workbench` serves it, and the browser that looks at it."""

import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from playwright.sync_api import Browser, sync_playwright

ROOT: Final = Path(__file__).resolve().parents[2]
STARTS_S: Final = 120.0  # until the page answers, on a machine that does other things too
HERE: Final = "127.0.0.1"
ARGUMENTS: Final = ("--no-sandbox", "--disable-gpu")  # root in a container has neither


class NoBrowserError(RuntimeError):
    """There is no Chromium; the message says what to do."""


def free_port() -> int:
    """A port that nobody listens to."""
    with socket.socket() as probe:
        probe.bind((HERE, 0))
        return probe.getsockname()[1]


@contextmanager
def served(cache: Path, said: Path, words: Sequence[str] = ()) -> Iterator[str]:
    """Address of a workbench with these further words of its command line; what it prints goes to `said`."""
    port = free_port()
    line = ["cruise", "workbench", "--no-browser", "--port", str(port), *words]
    # Nothing of pytest, and of its warnings, in the server.
    env = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "NICEGUI"))}
    env |= {"XDG_CACHE_HOME": str(cache), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
    with said.open("w") as stream:
        process = subprocess.Popen(
            [sys.executable, "-c", f"import sys; sys.argv = {line!r}; from cruise.cli import main; main()"],
            cwd=ROOT, env=env, stdout=stream, stderr=subprocess.STDOUT,
        )  # fmt: skip
        address = f"http://{HERE}:{port}"
        try:
            _wait(address, process, said)
            yield address
        finally:
            process.terminate()
            process.wait(30)


@contextmanager
def chromium() -> Iterator[Browser]:
    """A headless Chromium. NoBrowserError where there is none."""
    found = subprocess.run([ROOT / "tools" / "browser"], capture_output=True, text=True)
    if found.returncode:
        raise NoBrowserError(found.stderr.strip())
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found.stdout.split()[-1], args=list(ARGUMENTS))
        yield browser
        browser.close()


def _wait(address: str, process: subprocess.Popen, said: Path) -> None:
    until = time.monotonic() + STARTS_S
    while time.monotonic() < until:
        if process.poll() is not None:
            raise RuntimeError(f"the workbench ended: {said.read_text()}")
        try:
            with urllib.request.urlopen(address, timeout=5):
                return
        except urllib.error.HTTPError:  # it answers, and wants a token
            return
        except OSError:
            time.sleep(0.2)
    raise RuntimeError(f"no answer from {address}: {said.read_text()}")
