"""The figures of `cruise demo`, headless, for several seeds, and how fast the whole drive runs over the bus."""

from collections.abc import Sequence
from time import perf_counter

from cruise import settings
from cruise.plant import PlantSettings
from cruise.service import course, demo
from cruise.service import settings as service_settings

from .figures import Figure, Part
from .recordings import CONFIG

SEEDS = (0, 1, 2, 3, 4)
SECONDS = 180.0
TARGETS = {  # issue 2: name, unit, greatest value
    "rms_error_mps": ("m/s", 0.03),
    "steady_error_mps": ("m/s", 0.01),  # "no steady-state error": a third of the rms error that is allowed, our bound
    "overshoot_pct": ("%", 10.0),
    "command_above_1hz_rms_pct": ("%", 0.5),
    "accel_max_mps2": ("m/s2", 1.0),
}


def measure(seeds: Sequence[int] = SEEDS, seconds: float = SECONDS) -> Part:
    """Drive every seed once."""
    plant = settings.load(CONFIG / "plant.yaml", PlantSettings)
    cruise, drive = service_settings.load(CONFIG / "cruise.yaml"), course.load(CONFIG / "demo.yaml")
    reports, took_s = [], 0.0
    for seed in seeds:
        begin_s = perf_counter()
        result = demo.run(cruise, plant, drive, seed, seconds)
        took_s += perf_counter() - begin_s
        reports.append(result.report())
    # A figure that a drive does not have, such as the overshoot of one without a change, is NaN, and so is the worst.
    table = {
        name: [float("nan") if report[name] is None else float(report[name]) for report in reports] for name in TARGETS
    }
    figures = [
        Figure(f"{name}_worst", _largest(table[name]), unit, f"{name}, largest of all seeds", at_most)
        for name, (unit, at_most) in TARGETS.items()
    ]
    figures.append(
        Figure("times_real_time", len(seeds) * seconds / took_s, "1", "whole drive over the bus, times real time")
    )
    return Part(tuple(figures), tuple(seeds), series={"seed": [float(seed) for seed in seeds], **table})


def _largest(values: Sequence[float]) -> float:
    sizes = [abs(value) for value in values]
    return float("nan") if any(size != size for size in sizes) else max(sizes)
