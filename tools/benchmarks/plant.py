"""How many times faster than real time the virtual combine runs on one core, its sensors included."""

import random
from time import process_time

from cruise import settings
from cruise.plant import Combine, Inputs, PlantSettings

from .figures import Figure, Part
from .recordings import CONFIG

SEED = 1
SECONDS = 30.0  # s of driving in one run
RUNS = 9
COMMAND_S = 0.05  # s, period of the command
FASTER = 200.0  # issue 2: times real time on one core


def measure(seconds: float = SECONDS, runs: int = RUNS) -> Part:
    """Drive on a new random current every command; the processor's own time counts, not the wall clock's."""
    plant = settings.load(CONFIG / "plant.yaml", PlantSettings)
    times, readings = [], 0
    for _ in range(runs):
        combine, noise, readings = Combine(plant, SEED), random.Random(SEED), 0
        begin_s = process_time()
        for k in range(1, round(seconds / COMMAND_S) + 1):
            readings += len(combine.advance(Inputs(noise.uniform(450.0, 1100.0)), k * COMMAND_S))
        times.append(seconds / (process_time() - begin_s))
    times.sort()
    figures = (
        Figure("times_real_time", times[runs // 2], "1", "virtual combine, times real time, median", at_least=FASTER),
        Figure("times_real_time_worst", times[0], "1", "virtual combine, times real time, worst run"),
        Figure("times_real_time_best", times[-1], "1", "virtual combine, times real time, best run"),
    )
    note = f"step {1e3 * plant.step_s:.0f} ms, {readings / seconds:.0f} readings/s, {runs} runs of {seconds:.0f} s"
    return Part(figures, (SEED,), (note,))
