"""The virtual machine: Debian's user-mode Linux, a whole kernel that runs as a program, over the files of this machine.

Its root file system is this machine's, with everything that is written kept in the machine's memory; only the folder to
keep is written through. `init` puts it together. Output of the command comes over its serial line, the kernel's own
messages over its console, into a file that is shown where the machine did not come up.

Programs in it run at this machine's speed on one core of it, but a call of the kernel takes some 20 us, and a page that
is touched first some 100 us. It has this machine's clock. So that deadlines in it are kept or missed by what runs in
it, it comes before everything else on its core, where that is allowed, and one such machine runs at a time.

Source: Linux kernel documentation, virt/uml/user_mode_linux_howto_v2.rst.
"""

import contextlib
import fcntl
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from tools.vcan import debian

INIT = Path(__file__).with_name("init")
MEMORY_MB = 3072  # at most; it is taken as it is used
PASSED_ON = ("PATH", "HOME", "LANG", "LC_ALL", "CI", "MPLBACKEND", "COLUMNS")
NEW_REGISTERS = "amx_tile"  # flag of processors that have more registers than the kernel keeps, see registers.c
REGISTERS = Path(__file__).with_name("registers.c")
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
    before = _with_all_registers(folder)
    console, exit_code = folder / "console", task / "exit_code"
    with console.open("wb") as said, (debian.cache() / "running").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        _come_first()
        linux = [
            "setpriv", "--pdeathsig", "TERM", *before,  # it ends with this program, however that ends
            str(parts.kernel), f"mem={MEMORY_MB}M", f"initrd={_initramfs(parts, folder)}", f"uml_dir={folder}/",
            "con=null", f"con0=null,fd:{said.fileno()}", "ssl0=null,fd:1", "quiet", "panic=-1", "selinux=0",
            f"vcan_task={task}",
        ]  # fmt: skip
        subprocess.run(linux, stdin=subprocess.DEVNULL, stderr=said, pass_fds=[said.fileno()], check=False)
    if not exit_code.is_file():
        last = console.read_text(encoding="utf-8", errors="replace")[-2000:]
        raise debian.UnavailableError(f"the virtual machine ended before the command did; its kernel said\n{last}")
    return int(exit_code.read_text(encoding="utf-8"))


def _come_first() -> None:
    """Stay on one core, and before all ordinary programs there; what is started from here inherits it."""
    # Program and kernel take turns several thousand times a second: on two cores each turn takes three times as long.
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))


def _with_all_registers(folder: Path) -> list[str]:
    """Return what goes before the kernel, so that it runs whatever registers the processor has."""
    if NEW_REGISTERS not in Path("/proc/cpuinfo").read_text(encoding="utf-8"):
        return []
    if shutil.which("cc") is None:
        raise debian.UnavailableError("on a processor with AMX the virtual machine needs a C compiler (apt: gcc)")
    library = folder / "registers.so"
    compile_it = ["cc", "-O2", "-shared", "-fPIC", "-o", str(library), str(REGISTERS)]
    ran = subprocess.run(compile_it, capture_output=True, text=True, check=False)
    if ran.returncode != 0:
        raise debian.UnavailableError(f"cc can't compile {REGISTERS.name}: {ran.stderr.strip()}")
    return ["env", f"LD_PRELOAD={library}"]


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
