"""The paper's experiments on the virtual combine: one machine, one set of experiments, all tables.

White noise to fit on and an independent one to judge on, steps, a slow ramp up and down, a minute of noise at every
mass and slope of Table VI, steps in the four gears and at four speeds of the engine. Sampled at 20 Hz; the input is
the steering current that was applied, as in the paper, not its measurement, in which noise that changes every 0.05 s is
blurred. Source: sections III to V of Coen et al. 2005.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from cruise import settings
from cruise.control.commissioning import Conditions, Experiment
from cruise.paper.published import Gain, Published
from cruise.plant import PlantSettings
from cruise.recording import Recording
from cruise.service import experiments
from cruise.signals import INPUT

RATE_HZ: Final = 20.0  # section III
GEARS: Final = (1, 2, 3, 4)
ENGINE_SPEEDS_RPM: Final = (1300.0, 1600.0, 1900.0, 2100.0)  # section V.A: 1300 to 2100 rpm
CONTEXT: Final = ("engine_speed_rpm", "gear")
NAMES: Final = ("noise", "noise_unseen", "noise_minute", "steps", "ramp", "gear_steps")


@dataclass(frozen=True)
class Setting:
    """The machine and its experiments."""

    plant: PlantSettings
    experiments: Mapping[str, Experiment]


@dataclass(frozen=True, eq=False)
class Records:
    """All recordings of one seed."""

    noise: Recording
    unseen: Recording
    steps: Recording
    ramp: Recording
    gains: tuple[tuple[Gain, Recording], ...]  # rows of Table VI
    gears: dict[int, Recording]
    engine_speeds: dict[float, Recording]


def load(folder: Path) -> Setting:
    """The machine and its experiments of a folder. SettingsError where one is missing."""
    path = folder / "experiments.yaml"
    found = experiments.load(path)
    missing = [name for name in NAMES if name not in found]
    if missing:
        raise settings.SettingsError(
            f"{path}: no experiment named {', '.join(missing)}; the paper needs all of {NAMES}"
        )
    return Setting(settings.load(folder / "combine.yaml", PlantSettings), found)


def drive(setting: Setting, published: Published, seed: int) -> Records:
    """Drive all experiments with one seed, which draws the noise of excitation, road and sensors."""

    def record(name: str, conditions: Conditions | None = None) -> Recording:
        experiment = experiments.altered(setting.experiments[name], conditions, seed)
        driven = experiments.drive(experiment, setting.plant, rate_hz=RATE_HZ, context=CONTEXT)
        current = experiment.current()
        command_ma = np.array([current.current_ma(current.begin_s + k / RATE_HZ) for k in range(len(driven))])
        return replace(driven, columns={**driven.columns, INPUT: command_ma})

    def on(name: str, **changes: float) -> Conditions:
        return msgspec.structs.replace(setting.experiments[name].conditions, **changes)

    rows = published.dc_gain_pct
    return Records(
        noise=record("noise"),
        unseen=record("noise_unseen"),
        steps=record("steps"),
        ramp=record("ramp"),
        gains=tuple(
            (
                row,
                record(
                    "noise_minute", on("noise_minute", grade_deg=row.grade_deg, machine_mass_kg=row.machine_mass_kg)
                ),
            )
            for row in rows
        ),
        gears={gear: record("gear_steps", on("gear_steps", gear=gear)) for gear in GEARS},
        engine_speeds={rpm: record("gear_steps", on("gear_steps", engine_speed_rpm=rpm)) for rpm in ENGINE_SPEEDS_RPM},
    )
