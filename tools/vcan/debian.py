"""What the virtual machine is made of, out of Debian's packages: fetched and unpacked once, kept in the user's cache.

The packages are unpacked, not installed: no root, and nothing of this machine is changed.
"""

import fcntl
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

PACKAGES = ("user-mode-linux", "busybox-static", "can-utils")
MODULES = (  # in the order in which they are loaded: each after those that it needs
    "fs/overlayfs/overlay", "fs/autofs/autofs4",
    "net/can/can", "net/can/can-raw", "net/can/can-bcm", "net/can/can-gw", "net/can/j1939/can-j1939",
    "drivers/net/can/dev/can-dev", "drivers/net/can/vcan",
)  # fmt: skip


class UnavailableError(Exception):
    """No bus can be had on this machine; the message says what is missing and who can help."""


@dataclass(frozen=True)
class Parts:
    """The files of the machine."""

    kernel: Path  # a program
    modules: tuple[Path, ...]  # in the order in which they are loaded
    busybox: Path
    can_utils: Path  # folder of cansend, candump and the others


def cache() -> Path:
    """Return the folder in which the parts are kept; it may be deleted at any time."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "cruise-vcan"


def parts(say: Callable[[str], None]) -> Parts:
    """Return the parts, fetched if they are not there yet. Raises UnavailableError."""
    folder = cache()
    folder.mkdir(parents=True, exist_ok=True)
    unpacked = folder / "unpacked"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not unpacked.is_dir():
            _fetch(unpacked, say)
    modules = next((unpacked / "usr/lib/uml/modules").iterdir()) / "kernel"
    return Parts(
        kernel=unpacked / "usr/bin/linux.uml",
        modules=tuple(modules / f"{name}.ko" for name in MODULES),
        busybox=unpacked / "bin/busybox",
        can_utils=unpacked / "usr/bin",
    )


def _fetch(unpacked: Path, say: Callable[[str], None]) -> None:
    if shutil.which("apt-get") is None or shutil.which("dpkg-deb") is None:
        raise UnavailableError("apt-get and dpkg-deb, which get the kernel of the virtual machine, are not here")
    with tempfile.TemporaryDirectory(dir=unpacked.parent) as scratch:
        if os.geteuid() == 0:
            _apt("update")  # lists that are old name packages that are gone
        say(f"fetching {', '.join(PACKAGES)} into {unpacked.parent}")
        _apt("download", *PACKAGES, where=scratch)
        whole = Path(scratch) / "whole"
        for package in Path(scratch).glob("*.deb"):
            subprocess.run(["dpkg-deb", "-x", str(package), str(whole)], check=True)
        whole.rename(unpacked)


def _apt(verb: str, *arguments: str, where: str | None = None) -> None:
    ran = subprocess.run(
        ["apt-get", "-q", verb, *arguments],
        cwd=where,
        env={**os.environ, "DEBIAN_FRONTEND": "noninteractive"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if ran.returncode != 0:
        raise UnavailableError(f"apt-get {verb} failed: {(ran.stderr.strip() or ran.stdout.strip()).splitlines()[-1]}")
