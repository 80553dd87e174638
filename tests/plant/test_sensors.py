"""The sensors of the virtual combine: rates, order, noise, steps, delays, and the two speeds."""

from collections import defaultdict
from itertools import pairwise

import numpy as np
import pytest
from msgspec import structs

from cruise.plant import Combine, EffectFactors, Inputs, PlantSettings, SensorReading
from cruise.plant.sensors import BLOCK, SensorSettings
from cruise.signals import SIGNALS, Reading

RATES_HZ = {
    ("drive_feedback", "ground_speed_mps"): 50.0,
    ("drive_feedback", "pump_current_ma"): 50.0,
    ("ground_speed_mps", "ground_speed_mps"): 10.0,
    ("wheel_speed_mps", "wheel_speed_mps"): 10.0,
    ("engine_speed_rpm", "engine_speed_rpm"): 50.0,
    ("engine_load_pct", "engine_load_pct"): 20.0,
    ("gear", "gear"): 10.0,
    ("pitch_deg", "pitch_deg"): 100.0,
    ("oil_temperature_c", "oil_temperature_c"): 1.0,
    ("machine_mass_kg", "machine_mass_kg"): 1.0,
    ("line_pressure_bar", "line_pressure_bar"): 20.0,
}


def by_sensor(readings: list[Reading]) -> dict[tuple[str, str], list[Reading]]:
    grouped = defaultdict(list)
    for reading in readings:
        assert isinstance(reading, SensorReading)
        grouped[reading.sensor, reading.name].append(reading)
    return dict(grouped)


def values(readings: list[Reading]) -> np.ndarray:
    return np.array([reading.value for reading in readings])


@pytest.fixture(scope="module")
def readings() -> list[Reading]:
    return Combine(PlantSettings(), seed=5).advance(Inputs(850.0), 40.0)


def test_every_sensor_keeps_its_rate(readings: list[Reading]) -> None:
    grouped = by_sensor(readings)
    assert grouped.keys() == RATES_HZ.keys()
    for sensor, rate_hz in RATES_HZ.items():
        assert len(grouped[sensor]) == pytest.approx(40.0 * rate_hz, abs=1)
        steps_s = np.diff([reading.time_s for reading in grouped[sensor]])
        assert np.abs(steps_s - 1.0 / rate_hz).max() <= 0.002 + 1e-9
        assert steps_s.std() > 1e-4


def test_readings_come_in_time_order_with_known_names_in_their_ranges(readings: list[Reading]) -> None:
    assert all(first.time_s <= second.time_s for first, second in pairwise(readings))
    assert readings[0].time_s >= 0.0
    assert readings[-1].time_s <= 40.0
    for reading in readings:
        assert SIGNALS[reading.name].low <= reading.value <= SIGNALS[reading.name].high


def test_speed_and_current_of_the_drive_are_of_the_same_instants(readings: list[Reading]) -> None:
    grouped = by_sensor(readings)
    speed, current = grouped["drive_feedback", "ground_speed_mps"], grouped["drive_feedback", "pump_current_ma"]
    assert [reading.time_s for reading in speed] == [reading.time_s for reading in current]


@pytest.mark.parametrize(
    ("sensor", "name", "noise"),
    [
        ("drive_feedback", "ground_speed_mps", 0.015),
        ("drive_feedback", "pump_current_ma", 1.0),
        ("ground_speed_mps", "ground_speed_mps", 0.02),
        ("pitch_deg", "pitch_deg", 0.25),
        ("line_pressure_bar", "line_pressure_bar", 1.5),
    ],
)
def test_noise_has_its_deviation(readings: list[Reading], sensor: str, name: str, noise: float) -> None:
    settled = [reading for reading in by_sensor(readings)[sensor, name] if reading.time_s > 8.0]
    assert values(settled).std() == pytest.approx(noise, rel=0.15)


def test_values_come_in_the_steps_of_their_message(readings: list[Reading]) -> None:
    grouped = by_sensor(readings)
    for (sensor, name), resolution in {
        ("drive_feedback", "ground_speed_mps"): 0.001,
        ("engine_speed_rpm", "engine_speed_rpm"): 0.125,
        ("machine_mass_kg", "machine_mass_kg"): 10.0,
    }.items():
        counts = values(grouped[sensor, name]) / resolution
        assert np.abs(counts - counts.round()).max() < 1e-6


def ideal(**factors: float) -> PlantSettings:
    return PlantSettings(effects=EffectFactors(sensor_noise=0.0, sensor_resolution=0.0, sampling_jitter=0.0, **factors))


def test_a_delayed_sensor_shows_the_past() -> None:
    prompt, late = (by_sensor(Combine(ideal(sensor_delay=d), 1).advance(Inputs(900.0), 3.0)) for d in (0.0, 1.0))
    sensor = ("ground_speed_mps", "ground_speed_mps")
    truth = prompt["drive_feedback", "ground_speed_mps"]
    shown_at_s = np.array([reading.time_s for reading in late[sensor]])
    past = np.interp(shown_at_s - 0.1, [reading.time_s for reading in truth], values(truth))
    assert values(late[sensor]) == pytest.approx(past, abs=0.01)
    assert np.abs(values(late[sensor]) - values(prompt[sensor])).max() > 0.1


def test_pitch_takes_acceleration_for_slope() -> None:
    combine = Combine(ideal(sensor_delay=0.0), seed=1)
    seen = []
    for period in range(1, 60):
        readings = by_sensor(combine.advance(Inputs(900.0, grade_deg=2.0), period * 0.05))
        seen.append((readings["pitch_deg", "pitch_deg"][-1].value, combine.truth.acceleration_mps2))
    pitch_deg, acceleration_mps2 = np.array(seen).T
    assert acceleration_mps2.max() > 1.0
    assert pitch_deg == pytest.approx(2.0 + np.degrees(np.arctan(acceleration_mps2 / 9.80665)), abs=1.0)
    assert pitch_deg.max() > 2.0 + 5.0


def test_wheels_turn_faster_than_the_ground_passes_uphill() -> None:
    combine = Combine(PlantSettings(), seed=1)
    combine.advance(Inputs(900.0, grade_deg=8.0, rolling_resistance=0.1), 10.0)
    assert 1.03 < combine.truth.wheel_speed_mps / combine.truth.ground_speed_mps < 1.2
    combine.advance(Inputs(900.0, grade_deg=-8.0), 20.0)
    assert combine.truth.wheel_speed_mps < 0.995 * combine.truth.ground_speed_mps


def test_another_rate_of_one_sensor_leaves_the_others_as_they_were() -> None:
    settings = PlantSettings()
    faster = structs.replace(settings.sensors, pitch_deg=SensorSettings(rate_hz=37.0, noise=1.0))
    one = by_sensor(Combine(settings, seed=2).advance(Inputs(800.0), 5.0))
    other = by_sensor(Combine(structs.replace(settings, sensors=faster), seed=2).advance(Inputs(800.0), 5.0))
    assert len(other["pitch_deg", "pitch_deg"]) == pytest.approx(5.0 * 37.0, abs=1)
    for sensor in RATES_HZ.keys() - {("pitch_deg", "pitch_deg")}:
        assert one[sensor] == other[sensor]


def test_noise_goes_on_beyond_a_block() -> None:
    readings = Combine(PlantSettings(), seed=1).advance(Inputs(0.0), 35.0)
    pitch = values(by_sensor(readings)["pitch_deg", "pitch_deg"])
    assert len(pitch) > 3 * BLOCK
    assert np.abs(np.corrcoef(pitch[:BLOCK], pitch[BLOCK : 2 * BLOCK])[0, 1]) < 0.15


def test_rate_of_the_drive_can_be_changed_under_way() -> None:
    settings = PlantSettings()
    slow = structs.replace(
        settings.sensors, drive_feedback=structs.replace(settings.sensors.drive_feedback, rate_hz=5.0)
    )
    combine = Combine(settings, seed=1)
    combine.advance(Inputs(800.0), 2.0)
    combine.change(structs.replace(settings, sensors=slow))
    readings = by_sensor(combine.advance(Inputs(800.0), 6.0))
    assert len(readings["drive_feedback", "pump_current_ma"]) == pytest.approx(20, abs=1)
