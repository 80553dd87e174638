"""How long a diagnosis takes and how much memory: 15 minutes at 20 Hz, every signal, every effect; and ten times that.

Each runs in a fresh process, so that its peak of memory is its own. Times are those of the fit of the model without
effects and of the search; reading the file and starting Python are left out. Targets are held against CPU time, which
others who use the machine change by a quarter, not by a multiple as they do wall time.
"""

import pickle
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, process_time
from typing import Final

import numpy as np

from cruise.identification.structures import parse
from cruise.recording import Recording
from cruise.validation import study as studies
from cruise.validation.diagnose import diagnose
from cruise.validation.explanation import Explanation
from tools.trial.sizing import MODEL, MODEL_PERIOD_S

from .figures import Figure
from .peers import ROOT

TIMES: Final = 10  # as much data in the long recording
MEDIAN_S, WORST_S, RATIO_AT_MOST, PEAK_MB = 10.0, 20.0, 12.0, 1000.0


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
    wall_s, cpu_s = perf_counter(), process_time()
    found = diagnose(studies.study(recordings, parse(MODEL), None, MODEL_PERIOD_S))
    wall_s, cpu_s = perf_counter() - wall_s, process_time() - cpu_s
    answer = Diagnosed(
        verdict=found.verdict.value,
        effects=found.effects,
        final=found.final.explanation,
        cpu_s=cpu_s,
        wall_s=wall_s,
        peak_mb=peak_mb(),
    )
    Path(path).write_bytes(pickle.dumps(answer))


def peak_mb() -> float:
    """Largest resident memory of this process in MB; ru_maxrss would count that of the process which started it."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1.024e-3 * float(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def figures(ordinary: Sequence[Diagnosed], long: Diagnosed, of: Diagnosed) -> list[Figure]:
    """Times and memory; `long` is the same machine as `of` for TIMES as long."""
    cpu_s, wall_s = ([getattr(one, name) for one in ordinary] for name in ("cpu_s", "wall_s"))
    peak = max(one.peak_mb for one in ordinary)
    return [
        Figure("cpu_median_s", float(np.median(cpu_s)), "s", f"diagnosis, {len(cpu_s)} drives: CPU, median", MEDIAN_S),
        Figure("cpu_worst_s", max(cpu_s), "s", "CPU, worst", WORST_S),
        Figure("wall_median_s", float(np.median(wall_s)), "s", "wall, median"),
        Figure("wall_worst_s", max(wall_s), "s", "wall, worst"),
        Figure("peak_mb", peak, "MB", "peak of memory, worst", PEAK_MB),
        Figure("long_cpu_s", long.cpu_s, "s", f"{TIMES} times the data: CPU"),
        Figure("long_ratio", long.cpu_s / of.cpu_s, "1", "over that of once the data", RATIO_AT_MOST),
        Figure("long_peak_mb", long.peak_mb, "MB", "peak of memory", PEAK_MB),
    ]
