"""How many times faster than real time the virtual combine runs: what tools/plant_speed says."""

import re
import subprocess
from pathlib import Path

from .figures import Figure, Part

SPEED = Path(__file__).resolve().parents[1] / "plant_speed"
FASTER = 200.0  # issue 2: times real time on one core


def measure() -> Part:
    """Run tools/plant_speed. Raises ValueError where its line has another form."""
    said = subprocess.run([SPEED], check=True, capture_output=True, text=True).stdout.strip()
    found = re.search(r"(\d+) times real time \(median of \d+; best (\d+)\)", said)
    if found is None:
        raise ValueError(f"tools/plant_speed said: {said}")
    median, best = (float(group) for group in found.groups())
    figures = (
        Figure("times_real_time", median, "1", "virtual combine, times real time, median", at_least=FASTER),
        Figure("times_real_time_best", best, "1", "virtual combine, times real time, best run"),
    )
    return Part(figures, notes=(said,))
