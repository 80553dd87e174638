"""The virtual machine: Debian's kernel in QEMU, the files of this machine under it, a command or systemd on top.

The root file system is this machine's, over 9p, with everything that is written kept in the machine's memory; only the
folder to keep is written through. `init` puts it together. Output of the command comes over the second serial line,
the kernel's own messages over the first, into a file that is shown where the machine did not come up.

The machine's time is counted in its instructions, one a nanosecond (QEMU's icount): it is a computer of one core and
1 GHz, whatever else the host does meanwhile. So deadlines in it are kept or missed by the program, not by the host, and
a minute in it may take several. The processor is emulated: hardware acceleration can't count, and often isn't there.
"""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from tools.vcan import debian

INIT = Path(__file__).with_name("init")
MEMORY_MB = 3072
PASSED_ON = ("PATH", "HOME", "LANG", "LC_ALL", "CI", "MPLBACKEND", "COLUMNS")
PASSED_ON_PREFIXES = ("CRUISE_", "OMP_", "OPENBLAS_", "PYTEST_", "PYTHON", "HYPOTHESIS_")


def run(command: Sequence[str], keep: Path | None, folder: Path, systemd: bool, say: Callable[[str], None]) -> int:
    """Run `command` in the machine and return its exit code; `folder` is for what is needed meanwhile.

    Raises UnavailableError where the machine cannot be had or does not come up.
    """
    parts = debian.parts(say)
    keep = (folder / "keep" if keep is None else keep).resolve()
    keep.mkdir(parents=True, exist_ok=True)
    task = folder / "task"
    task.mkdir()
    (task / "command").write_text(_script(command, parts.can_utils), encoding="utf-8")
    (task / "keep").write_text(f"{keep}\n", encoding="utf-8")
    (task / "process1").write_text("systemd\n" if systemd else "command\n", encoding="utf-8")
    console, exit_code = folder / "console", task / "exit_code"
    # fmt: off
    qemu = [
        debian.QEMU, "-M", "pc", "-accel", "tcg,thread=single", "-icount", "shift=0", "-cpu", "Nehalem",
        "-m", str(MEMORY_MB), "-smp", "1", "-nodefaults", "-display", "none", "-no-reboot",
        "-kernel", str(parts.kernel), "-initrd", str(_initramfs(parts, folder)),
        "-append", "console=ttyS0 quiet panic=-1 mitigations=off tsc=reliable",
        "-serial", f"file:{console}", "-chardev", "stdio,id=out,signal=off", "-serial", "chardev:out",
        "-virtfs", "local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap",
        "-virtfs", f"local,path={keep},mount_tag=keep,security_model=none",
        "-virtfs", f"local,path={task},mount_tag=task,security_model=none",
    ]
    # fmt: on
    subprocess.run(qemu, stdin=subprocess.DEVNULL, check=False)
    if not exit_code.is_file():
        said = console.read_text(encoding="utf-8", errors="replace") if console.is_file() else ""
        raise debian.UnavailableError(
            f"the virtual machine ended before the command did; its kernel said\n{said[-2000:]}"
        )
    return int(exit_code.read_text(encoding="utf-8"))


def _script(command: Sequence[str], can_utils: Path) -> str:
    """Return the shell script that runs the command where and as it would run here."""
    kept = [name for name in os.environ if name in PASSED_ON or name.startswith(PASSED_ON_PREFIXES)]
    variables = "".join(f"export {name}={shlex.quote(os.environ[name])}\n" for name in sorted(kept))
    if not sys.stdout.isatty():
        variables += "export NO_COLOR=1 TERM=dumb\n"  # to the command its output looks like a terminal
    variables += f"export CRUISE_VCAN=vcan0 PATH=$PATH:{can_utils}\n"
    return f"{variables}cd {shlex.quote(str(Path.cwd()))}\n{shlex.join(command)}\n"


def _initramfs(parts: debian.Parts, folder: Path) -> Path:
    """Pack busybox, modules and `init` into the archive with which the kernel starts."""
    root, archive = folder / "initramfs", folder / "initramfs.cpio"
    for name in ("bin", "modules"):
        (root / name).mkdir(parents=True)
    shutil.copy(INIT, root / "init")
    (root / "init").chmod(0o755)
    shutil.copy(parts.busybox, root / "bin/busybox")
    for number, module in enumerate(parts.modules):
        shutil.copy(module, root / "modules" / f"{number:02}-{module.name}")
    names = "\n".join(str(path.relative_to(root)) for path in sorted(root.rglob("*")))
    with archive.open("wb") as out:
        pack = [str(parts.busybox), "cpio", "-o", "-H", "newc"]
        subprocess.run(pack, cwd=root, input=names.encode(), stdout=out, stderr=subprocess.DEVNULL, check=True)
    return archive
