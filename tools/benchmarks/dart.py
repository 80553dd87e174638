"""The online model on measured drives of a small car: learned from every other file, judged on the rest."""

import os
from pathlib import Path

from cruise import settings
from cruise.service import replay
from cruise.service import settings as service_settings
from cruise.service.recordings import ReadingSettings

from .figures import Figure, Part
from .recordings import CONFIG

DATA = "CRUISE_DATA"  # environment variable: the folder that holds dart/


def measure() -> Part:
    """3 s ahead errors on files that taught nothing; NaN without the data."""
    names = ("online", "batch", "factory", "persistence")
    data = os.environ.get(DATA)
    if not data:
        figures = tuple(Figure(f"{name}_mps", float("nan"), "m/s", f"{name}, 3 s ahead") for name in names)
        return Part(figures, notes=(f"{DATA} is not set: the measured drives are not here",))
    files = sorted((Path(data) / "dart").glob("*/*.csv"))
    loaded = service_settings.load(CONFIG / "dart.yaml")
    columns = settings.load(CONFIG / "dart_columns.yaml", ReadingSettings)
    taught = replay.replay(files[::2], loaded, columns)
    judged = replay.judge(taught, replay.replay(files[1::2], loaded, columns).recordings)
    errors = {name: float(getattr(judged, f"{name}_mps")) for name in names}
    figures = [Figure(f"{name}_mps", errors[name], "m/s", f"{name}, 3 s ahead, unseen files") for name in names]
    figures.append(
        Figure("online_over_persistence", errors["online"] / errors["persistence"], "1", "online / persistence")
    )
    figures.append(Figure("online_over_batch", errors["online"] / errors["batch"], "1", "online / batch least squares"))
    note = f"{len(files[::2])} files taught, {len(files[1::2])} judged, {judged.samples} predictions"
    return Part(tuple(figures), notes=(note,))
