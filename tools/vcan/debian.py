"""What the virtual machine is made of, out of Debian's packages: fetched and unpacked once, kept in the user's cache.

QEMU has to be installed, which takes root. Kernel, busybox and can-utils are only unpacked: no root, and nothing of
this machine is changed.
"""

import fcntl
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

QEMU = "qemu-system-x86_64"
MODULES = (
    "virtio_pci", "9p", "9pnet_virtio", "overlay", "vcan", "can-raw", "can-bcm", "can-gw", "can-j1939",
)  # fmt: skip


class UnavailableError(Exception):
    """No bus can be had on this machine; the message says what is missing and who can help."""


@dataclass(frozen=True)
class Parts:
    """The files of the machine."""

    kernel: Path
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
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if shutil.which(QEMU) is None:
            _install_qemu(say)
        if not (folder / "root").is_dir():
            _fetch(folder, say)
    root = folder / "root"
    kernel = next((root / "boot").glob("vmlinuz-*"))
    return Parts(kernel, _ordered(root, kernel), root / "bin/busybox", root / "usr/bin")


def _install_qemu(say: Callable[[str], None]) -> None:
    if shutil.which("apt-get") is None or os.geteuid() != 0:
        raise UnavailableError(f"{QEMU} is not installed, and it takes Debian and root to install it; do so by hand")
    say("installing qemu-system-x86")
    _apt("update")
    _apt("install", "-o", "DPkg::Lock::Timeout=300", "--yes", "--no-install-recommends", "qemu-system-x86")


def _fetch(folder: Path, say: Callable[[str], None]) -> None:
    if shutil.which("apt-get") is None or shutil.which("dpkg-deb") is None:
        raise UnavailableError("apt-get and dpkg-deb, which get the kernel of the virtual machine, are not here")
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        packages = ("linux-image-amd64", "busybox-static", "can-utils")
        if os.geteuid() == 0:
            _apt("update")  # lists that are old name packages that are gone
        shown = _output("apt-cache", "depends", packages[0])
        image = next((line.split()[-1] for line in shown.splitlines() if "Depends: linux-image" in line), None)
        if image is None:
            raise UnavailableError(f"apt knows no package {packages[0]}; see `apt-cache policy {packages[0]}`")
        say(f"fetching {image}, busybox and can-utils into {folder}")
        _apt("download", image, *packages[1:], where=scratch)
        unpacked = Path(scratch) / "unpacked"
        for package in Path(scratch).glob("*.deb"):
            subprocess.run(["dpkg-deb", "-x", str(package), str(unpacked)], check=True)
        _depmod(unpacked, image.removeprefix("linux-image-"))
        kept = Path(scratch) / "kept"
        for file in (*_wanted(unpacked), unpacked / "bin/busybox", *(unpacked / "usr/bin").iterdir()):
            target = kept / file.relative_to(unpacked)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(file, target)
        kept.rename(folder / "root")


def _depmod(root: Path, release: str) -> None:
    """Write modules.dep, by the busybox that was fetched."""
    with tempfile.TemporaryDirectory() as links:
        depmod = Path(links) / "depmod"
        depmod.symlink_to(root / "bin/busybox")
        subprocess.run([str(depmod), "-b", str(root), release], check=True)


def _wanted(root: Path) -> list[Path]:
    kernel = next((root / "boot").glob("vmlinuz-*"))
    return [kernel, _modules_dep(root, kernel), *_ordered(root, kernel)]


def _modules_dep(root: Path, kernel: Path) -> Path:
    return root / "lib/modules" / kernel.name.removeprefix("vmlinuz-") / "modules.dep"


def _ordered(root: Path, kernel: Path) -> tuple[Path, ...]:
    """Return the modules with all that they need, what is needed first. One that is built in has no file."""
    listing = _modules_dep(root, kernel)
    needs = {
        file: rest.split()
        for file, _, rest in (line.partition(":") for line in listing.read_text(encoding="utf-8").splitlines())
    }
    named = {Path(file).stem.replace("_", "-"): file for file in needs}
    order: list[str] = []

    def add(file: str) -> None:
        for needed in needs[file]:
            if needed not in order:
                add(needed)
        if file not in order:
            order.append(file)

    for module in MODULES:
        if module.replace("_", "-") in named:
            add(named[module.replace("_", "-")])
    return tuple(listing.parent / file if not file.startswith("/") else root / file[1:] for file in order)


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


def _output(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout
