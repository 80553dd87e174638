"""How long a diagnosis takes and how much memory: 15 minutes at 20 Hz, every signal, every effect; and ten times that.

Each runs in a fresh process, so that its peak of memory is its own. Times are those of the fit of the model without
effects and of the search; reading the file and starting Python are left out. Targets are held against the time that
a user waits, on the cores that there are; the CPU time of all of them, which others who use the machine change less,
stands beside it. Memory is what the process and its children hold, what they share counted once.
"""

import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread
from time import perf_counter
from typing import Final

import numpy as np

from cruise.identification.structures import parse
from cruise.recording import Recording
from cruise.validation import study as studies
from cruise.validation.diagnose import diagnose
from cruise.validation.explanation import Explanation
from tools.trial.run import processor_s
from tools.trial.sizing import MODEL, MODEL_PERIOD_S

from .figures import Figure
from .peers import ROOT

TIMES: Final = 10  # as much data in the long recording
MEDIAN_S, WORST_S, RATIO_AT_MOST, PEAK_MB = 10.0, 20.0, 12.0, 1000.0
WATCHED_S: Final = 0.1  # between looks at the memory


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """What a diagnosis said, and what it took."""

    verdict: str
    effects: tuple[str, ...]
    final: Explanation  # the model with what was chosen
    cpu_s: float
    wall_s: float
    peak_mb: float


def diagnosed(recordings: Sequence[Recording]) -> Diagnosed:
    """`cruise diagnose` on recordings, told nothing else, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recordings"
        path.write_bytes(pickle.dumps(list(recordings)))
        call = f"from {__name__} import serve; serve({str(path)!r})"
        subprocess.run([sys.executable, "-c", call], cwd=ROOT, check=True)
        return pickle.loads(path.read_bytes())


def serve(path: str) -> None:
    """Diagnose the recordings of a file and put the answer in its place."""
    recordings: list[Recording] = pickle.loads(Path(path).read_bytes())
    with held_mb() as looks:
        wall_s, cpu_s = perf_counter(), processor_s()
        found = diagnose(studies.study(recordings, parse(MODEL), None, MODEL_PERIOD_S))
        wall_s, cpu_s = perf_counter() - wall_s, processor_s() - cpu_s
    answer = Diagnosed(
        verdict=found.verdict.value,
        effects=found.effects,
        final=found.final.explanation,
        cpu_s=cpu_s,
        wall_s=wall_s,
        peak_mb=max(looks),
    )
    Path(path).write_bytes(pickle.dumps(answer))


@contextmanager
def held_mb() -> Iterator[list[float]]:
    """Memory in MB of this process and its children, looked at again and again, once more at the end."""
    looks: list[float] = []
    over = Event()

    def look() -> None:
        while not over.wait(WATCHED_S):
            looks.append(sum(_held_mb(pid) for pid in (os.getpid(), *_children())))

    watch = Thread(target=look)
    watch.start()
    try:
        yield looks
    finally:
        over.set()
        watch.join()
        looks.append(_held_mb(os.getpid()))


def _children() -> list[int]:
    return [int(pid) for one in Path("/proc/self/task").glob("*/children") for pid in one.read_text().split()]


def _held_mb(pid: int) -> float:
    """Pss: what several hold together is shared out among them."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:  # it has ended meanwhile
        return 0.0
    return next((1.024e-3 * float(line.split()[1]) for line in lines if line.startswith("Pss:")), 0.0)


def figures(ordinary: Sequence[Diagnosed], long: Diagnosed, of: Diagnosed) -> list[Figure]:
    """Times and memory; `long` is the same machine as `of` for TIMES as long."""
    cpu_s, wall_s = ([getattr(one, name) for one in ordinary] for name in ("cpu_s", "wall_s"))
    peak = max(one.peak_mb for one in ordinary)
    return [
        Figure("wall_median_s", float(np.median(wall_s)), "s", f"diagnosis, {len(wall_s)} drives: median", MEDIAN_S),
        Figure("wall_worst_s", max(wall_s), "s", "worst", WORST_S),
        Figure("cpu_median_s", float(np.median(cpu_s)), "s", "CPU of all cores, median"),
        Figure("cpu_worst_s", max(cpu_s), "s", "CPU of all cores, worst"),
        Figure("peak_mb", peak, "MB", "peak of memory, worst", PEAK_MB),
        Figure("long_cpu_s", long.cpu_s, "s", f"{TIMES} times the data: CPU"),
        Figure("long_ratio", long.cpu_s / of.cpu_s, "1", "over that of once the data", RATIO_AT_MOST),
        Figure("long_peak_mb", long.peak_mb, "MB", "peak of memory", PEAK_MB),
    ]
