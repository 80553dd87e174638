"""The settings of the virtual combine: every effect can be switched off, and the file in config holds every number."""

import ast
from pathlib import Path

import msgspec
import pytest
from msgspec import structs

import cruise.plant
from cruise.plant import Combine, EffectFactors, Inputs, PlantSettings
from cruise.plant.settings import with_effects
from cruise.signals import Reading

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "config" / "plant.yaml"

# A drive that calls on every effect: full and small current, reverse, hill, soft soil, crop, grain, low rpm, neutral.
MANOEUVRES = [
    (3.0, Inputs(1250.0, gear=4)),
    (5.0, Inputs(0.0, gear=4, grade_deg=-4.0)),
    (
        7.0,
        Inputs(800.0, 1500.0, gear=1, grade_deg=5.0, rolling_resistance=0.1, crop_power_kw=250.0, grain_flow_kgps=20.0),
    ),
    (8.0, Inputs(600.0, gear=0)),
    (10.0, Inputs(-900.0, gear=2)),
]


def show(settings: PlantSettings) -> tuple[list[Reading], list[float]]:
    combine = Combine(settings, seed=1)
    readings, speeds = [], []
    for until_s, inputs in MANOEUVRES:
        readings += combine.advance(inputs, until_s)
        speeds.append(combine.truth.ground_speed_mps)
    return readings, speeds


BIASED = structs.replace(
    PlantSettings(),
    sensors=structs.replace(
        PlantSettings().sensors, wheel_speed_mps=structs.replace(PlantSettings().sensors.wheel_speed_mps, bias=0.05)
    ),
)
IN_THE_SENSORS = {
    "pitch_acceleration",
    "sensor_noise",
    "sensor_resolution",
    "sensor_delay",
    "sensor_bias",
    "sampling_jitter",
    "oil_warming",
}


@pytest.fixture(scope="module")
def whole() -> tuple[list[Reading], list[float]]:
    return show(BIASED)


@pytest.mark.parametrize("effect", EffectFactors.__struct_fields__)
@pytest.mark.parametrize("factor", [0.0, 0.5])
def test_every_effect_can_be_switched_off_and_scaled(
    whole: tuple[list[Reading], list[float]], effect: str, factor: float
) -> None:
    factors = structs.replace(EffectFactors(), **{effect: factor})
    readings, speeds = show(structs.replace(BIASED, effects=factors))
    assert all(abs(speed) < 12.0 for speed in speeds)
    if effect in IN_THE_SENSORS:
        assert readings != whole[0]
        assert effect == "oil_warming" or speeds == whole[1]
    else:
        assert max(abs(a - b) for a, b in zip(speeds, whole[1], strict=True)) > 1e-5


def test_factors_of_one_change_nothing() -> None:
    settings = with_effects(PlantSettings())
    assert settings.pump == PlantSettings().pump
    assert settings.sensors == PlantSettings().sensors
    assert settings.line == PlantSettings().line
    assert settings.transmission.gear_ratio == pytest.approx(PlantSettings().transmission.gear_ratio)


def test_everything_off_at_once_still_drives() -> None:
    """All but active braking, without which nothing would slow the machine down that has no friction either."""
    off = EffectFactors(**{**dict.fromkeys(EffectFactors.__struct_fields__, 0.0), "active_braking": 1.0})
    _, speeds = show(PlantSettings(effects=off))
    assert all(abs(speed) < 12.0 for speed in speeds)
    assert speeds[0] > 2.0
    assert speeds[-1] < -1.0


def test_config_file_holds_every_number_as_the_code_has_it() -> None:
    text = CONFIG.read_text(encoding="utf-8")
    assert msgspec.yaml.decode(text, type=PlantSettings) == PlantSettings()

    def keys(settings: msgspec.Struct) -> dict[str, object]:
        values = {name: getattr(settings, name) for name in settings.__struct_fields__}
        return {name: keys(v) if isinstance(v, msgspec.Struct) else None for name, v in values.items()}

    def keys_of(mapping: dict[str, object]) -> dict[str, object]:
        return {name: keys_of(v) if isinstance(v, dict) else None for name, v in mapping.items()}

    assert keys_of(msgspec.yaml.decode(text)) == keys(PlantSettings())


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("pump: {treshold_ma: 300.0}", "treshold_ma"),
        ("effects: {hysteresis: -1.0}", "hysteresis"),
        ("sensors: {drive_feedback: {rate_hz: 500.0}}", "rate_hz"),
        ("step_s: 0.1", "step_s"),
    ],
)
def test_misspelt_and_meaningless_settings_are_refused(wrong: str, message: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=message):
        msgspec.yaml.decode(wrong, type=PlantSettings)


def test_plant_imports_nothing_of_the_project_but_the_signals() -> None:
    package = Path(cruise.plant.__file__).parent
    imported = set()
    for file in package.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0
                imported.add(node.module)
            elif isinstance(node, ast.Import):
                imported.update(alias.name for alias in node.names)
    of_the_project = {name for name in imported if name and name.split(".")[0] == "cruise"}
    assert {name for name in of_the_project if not name.startswith("cruise.plant")} == {"cruise.signals"}
    others = {name.split(".")[0] for name in imported - of_the_project if name}
    assert others <= {"numpy", "msgspec", "math", "bisect", "collections", "dataclasses", "typing"}
