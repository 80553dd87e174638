"""SysIdentPy and SIPPY on the same samples, in an environment of their own: SysIdentPy refuses this project's numpy.

`Peers.start` makes out/peers-venv once and runs this file in it; every call is one line in and one line of JSON out:
the time in s of one fit, and its parameters as y_k = a_1 y_(k-1) + .. + b_0 u_(k-d) + .. + c_0 + e_k + c_1 e_(k-1) + ..
"""

import contextlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from time import perf_counter
from typing import Any, Final, Self

import numpy as np

ROOT: Final = Path(__file__).resolve().parents[2]
HOME: Final = ROOT / "out" / "peers-venv"
REQUIRED: Final = ("sysidentpy==0.9.0", "sippy_unipi==1.0.1", "pysindy==2.1.0")  # the last ones of November 2026
INSTALL_S: Final = 300.0  # s, for 120 MB of wheels
NA, NB, DELAY = 2, 2, 2  # of the system that is fitted


@dataclass(frozen=True, slots=True)
class Timed:
    """One fit: how long it took, and what it found: a, b, c_0, then the noise model's c."""

    seconds: float
    theta: tuple[float, ...]


class Peers:
    """The running peers. Use as a context manager; `start` says why where they can't be had."""

    def __init__(self, process: subprocess.Popen[str], folder: tempfile.TemporaryDirectory) -> None:
        self.process = process
        self.folder = folder

    @classmethod
    def start(cls, input_: np.ndarray, output: np.ndarray) -> "Peers | str":
        """The peers, told what to fit, or why there are none."""
        reason = made()
        if reason:
            return f"SysIdentPy and SIPPY are not installed: {reason}"
        folder = tempfile.TemporaryDirectory()
        data = Path(folder.name) / "data.npz"
        np.savez(data, input=input_, output=output)
        process = subprocess.Popen(
            [HOME / "bin" / "python", "-m", "tools.benchmarks.peers", data],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        return cls(process, folder)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.communicate()
        self.folder.cleanup()

    def fit(self, name: str) -> Timed:
        """One fit of one of FITS."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(name + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"{name}: the peers ended with code {self.process.wait()}")
        said = json.loads(line)
        return Timed(said["seconds"], tuple(said["theta"]))


def made() -> str:
    """Make the environment unless it is there; why it can't be made, empty where it is."""
    stamp = HOME / "installed"
    if stamp.is_file() and stamp.read_text() == " ".join(REQUIRED):
        return ""
    pip = [HOME / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *REQUIRED]
    for command in ([sys.executable, "-m", "venv", "--clear", HOME], pip):
        try:
            ended = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            return str(error)
        if ended.returncode:
            return (ended.stderr.strip().splitlines() or [f"code {ended.returncode}"])[-1]
    stamp.write_text(" ".join(REQUIRED))
    return ""


def _sysidentpy(u: np.ndarray, y: np.ndarray) -> Callable[[], list[float]]:
    selection = import_module("sysidentpy.model_structure_selection")
    basis = import_module("sysidentpy.basis_function")
    estimation = import_module("sysidentpy.parameter_estimation")
    inputs, outputs = u.reshape(-1, 1), y.reshape(-1, 1)

    def fit() -> list[float]:
        model = selection.FROLS(
            order_selection=False,
            n_terms=NA + NB + 1,
            ylag=NA,
            xlag=list(range(DELAY, DELAY + NB)),
            basis_function=basis.Polynomial(degree=1),
            estimator=estimation.LeastSquares(),
        )
        model.fit(X=inputs, y=outputs)
        names = [1001 + i for i in range(NA)] + [2000 + DELAY + j for j in range(NB)] + [0]
        found = dict(zip(model.final_model.ravel().tolist(), np.ravel(model.theta).tolist(), strict=True))
        return [found[name] for name in names]

    return fit


def _sippy(u: np.ndarray, y: np.ndarray, noise: int) -> Callable[[], list[float]]:
    sippy = import_module("sippy_unipi")
    orders = {"ARMAX_orders": [NA, NB, noise, DELAY - 1]} if noise else {"ARX_orders": [NA, NB, DELAY - 1]}
    inputs, outputs = u - u.mean(), y - y.mean()  # it has no c_0

    def fit() -> list[float]:
        model = sippy.system_identification(outputs, inputs, "ARMAX" if noise else "ARX", **orders)
        a = -model.G.den[0][0][1 : NA + 1]
        b = model.G.num[0][0][-NB:]
        c = model.H.num[0][0][1 : noise + 1]
        return [*a, *b, float(y.mean() * (1.0 - a.sum()) - u.mean() * b.sum()), *c]

    return fit


FITS: Final[dict[str, Callable[[np.ndarray, np.ndarray], Callable[[], list[float]]]]] = {
    "sysidentpy_arx": _sysidentpy,
    "sippy_arx": lambda u, y: _sippy(u, y, 0),
    "sippy_armax": lambda u, y: _sippy(u, y, 1),
}


def serve(path: str) -> None:
    """Answer the lines of stdin until it ends; what the peers print goes elsewhere."""
    with np.load(path) as data:
        u, y = data["input"], data["output"]
    ready: dict[str, Callable[[], Any]] = {}
    for line in sys.stdin:
        name, answer = line.strip(), sys.stdout
        with contextlib.redirect_stdout(sys.stderr):
            if name not in ready:
                ready[name] = FITS[name](u, y)
            begin_s = perf_counter()
            theta = ready[name]()
            seconds = perf_counter() - begin_s
        answer.write(json.dumps({"seconds": seconds, "theta": [float(value) for value in theta]}) + "\n")
        answer.flush()


if __name__ == "__main__":
    serve(sys.argv[1])
