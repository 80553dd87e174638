"""The kernel at hand: a network namespace of our own with vcan0 in it, so that no bus of the machine is touched."""

import os
import shutil
import subprocess
from collections.abc import Sequence

BUS = "ip link add vcan0 type vcan && ip link set vcan0 up && export CRUISE_VCAN=vcan0"


def command(wanted: Sequence[str]) -> list[str]:
    """Return `wanted` as it is run in a namespace with the bus."""
    as_root = [] if os.geteuid() == 0 else ["--map-root-user"]
    return ["unshare", "--net", *as_root, "sh", "-c", f'{BUS} && exec "$@"', "sh", *wanted]


def why_not() -> str | None:
    """Return why the kernel at hand gives no bus, None if it does. Modules are loaded where that is allowed."""
    missing = [name for name in ("unshare", "ip") if shutil.which(name) is None]
    if missing:
        return f"{' and '.join(missing)} (util-linux, iproute2) not found"
    if os.geteuid() == 0 and shutil.which("modprobe") is not None:
        subprocess.run(["modprobe", "-a", "vcan", "can-raw", "can-bcm", "can-j1939"], check=False, capture_output=True)
    tried = subprocess.run(command(["true"]), check=False, capture_output=True, text=True)
    if tried.returncode == 0:
        return None
    return f"this kernel gives no vcan0 ({tried.stderr.strip().splitlines()[-1] if tried.stderr else 'no rights'})"
