"""What an added effect is worth to the machine: the demo's speed error with the model before it and with it.

A drive is recorded in which the engine's speed moves; a structure that knows nothing of it is fitted, and the same with
the effect, as `cruise add` does. Then each drives the demo from its model file: same field, same operator, same noise.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from msgspec import structs

from cruise import settings
from cruise.identification.structures import parse
from cruise.model.history import undone
from cruise.plant import PlantSettings
from cruise.report.model_file import model_file
from cruise.service import course, demo
from cruise.service import settings as service_settings
from cruise.validation import ladder

from .figures import Figure, Part
from .recordings import CONFIG, PERIOD_S, drive

STRUCTURE, EFFECT = "arx:na=1,nb=3,delay_s=0.4+dead_zone+quadratic_gain", "engine_speed"
SEED, SECONDS = 77, 600.0  # of the recording
MADE_ON = "2026-01-01"  # in a file that is gone when the drives are over
SEEDS, DEMO_S = (0, 1), 180.0


def measure(seeds: Sequence[int] = SEEDS, recorded_s: float = SECONDS, demo_s: float = DEMO_S) -> Part:
    """Record, add, and drive every seed with both models."""
    plant = settings.load(CONFIG / "plant.yaml", PlantSettings)
    service, course_ = service_settings.load(CONFIG / "cruise.yaml"), course.load(CONFIG / "demo.yaml")
    recorded, structure = [drive(plant, SEED, recorded_s)], parse(STRUCTURE)
    study = ladder.begin(recorded, structure, None, None, PERIOD_S)
    added = ladder.add(study, EFFECT)
    floor = ladder.floor(study, recorded, added)
    better = model_file(STRUCTURE, structure, None, (), study, added, floor, MADE_ON)
    reports: dict[str, list[dict]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, file in (("before", undone("better.yaml", better)), ("after", better)):
            path = Path(folder) / f"{name}.yaml"
            settings.save(path, file)
            chosen = structs.replace(service, model=str(path))
            reports[name] = [demo.run(chosen, plant, course_, seed, demo_s).report() for seed in seeds]
    series = {
        f"{key}_{name}": [_number(one[f"{key}{unit}"]) for one in reports[name]]
        for key, unit in (("rms_error", "_mps"), ("overshoot", "_pct"))
        for name in reports
    }
    errors = {name: _mean(series[f"rms_error_{name}"]) for name in reports}
    figures = (
        Figure("model_error_before_mps", added.error_before_mps, "m/s", f"model without {EFFECT}, held out, 3 s ahead"),
        Figure("model_error_after_mps", added.error_after_mps, "m/s", "model with it"),
        Figure("rms_error_before_mps", errors["before"], "m/s", "demo's speed error without it, mean of all seeds"),
        Figure("rms_error_after_mps", errors["after"], "m/s", "demo's speed error with it"),
        Figure("rms_error_ratio", errors["after"] / errors["before"], "1", "with it over without it", at_most=1.0),
    )
    return Part(figures, (SEED, *seeds), series={"seed": [float(seed) for seed in seeds], **series})


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
