"""Effects in other forms than the usual one: a detent, oil that slows the servo, a spool that sticks, and more."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cruise import settings
from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.grade import Grade
from cruise.effects.oil_temperature import OilTemperature
from cruise.effects.sensor_bias import SensorBias
from cruise.model import files
from cruise.model.history import history_of, undone
from cruise.recording import Recording
from cruise.report.diagnosis import sentence
from cruise.report.model_file import model_file
from cruise.signals import INPUT, OUTPUT
from cruise.validation import ladder
from cruise.validation.diagnose import Diagnosis, Verdict, diagnose
from cruise.validation.study import study
from cruise.validation.unnamed import RestCurrent
from tests.validation.diagnosing import DT_S, PERIOD_S, PITCH, SAMPLES, SECONDS, STRUCTURE, found
from tests.validation.driving import (
    DELAY_S,
    FINE_S,
    GAIN,
    GRAVITY_MPS2,
    LAG_S,
    VEHICLE_S,
    drive,
    lagged,
    levels,
    wander,
)


def test_a_detent_is_a_dead_zone_that_gives_all_that_was_asked_for_beyond_it():
    one = found(command=lambda u: np.where(np.abs(u) > 400.0, u, 0.0))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("dead_zone",))
    (effect,) = one.final.explanation.effects
    assert isinstance(effect, DeadZone)
    currents_ma = np.abs(one.study.recordings[0].input)
    least_ma, most_ma = currents_ma[currents_ma < 400.0].max(), currents_ma[currents_ma > 400.0].min()
    assert least_ma - 3.0 < effect.threshold_ma < most_ma + 3.0, (
        "anywhere between what it stops and what it lets through"
    )
    assert effect.jump_share == 1.0


def test_a_drive_that_cold_oil_slows_down_is_told_by_the_oil():
    """Its dead time seems to change as well: that is what is left of the oil's, which acts before the vehicle."""
    oil_c = 30.0 + 35.0 * np.linspace(0.0, 1.0, SAMPLES) + wander(SAMPLES, DT_S, 14, 3.0, 8.0)
    columns = {"pitch_deg": PITCH, "oil_temperature_c": oil_c}

    def slow(current_ma: np.ndarray) -> np.ndarray:
        lags_s = 0.35 * np.exp((50.0 - oil_c) / 33.0)
        place, places = current_ma[0], []
        for now, lag_s in zip(current_ma.tolist(), lags_s.tolist(), strict=True):
            place += (1.0 - np.exp(-DT_S / lag_s)) * (now - place)
            places.append(place)
        return np.array(places)

    one = diagnose(study([drive(SECONDS, 4, DT_S, 0.01, columns=columns, command=slow)], STRUCTURE, None, PERIOD_S))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("oil_temperature",))
    (effect,) = one.final.explanation.effects
    assert isinstance(effect, OilTemperature)
    assert effect.pace_exponent > 0.2
    assert abs(effect.loss_share) < 0.01


def test_what_sticks_until_it_breaks_away_is_a_dead_zone():
    def sticking(current_ma: np.ndarray) -> np.ndarray:
        is_open, through = False, []
        for now in current_ma.tolist():
            is_open = abs(now) > (450.0 if is_open else 650.0)
            through.append(now if is_open else 0.0)
        return np.array(through)

    one = found(command=sticking)
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("dead_zone",))
    (effect,) = one.final.explanation.effects
    assert isinstance(effect, DeadZone)
    assert effect.jump_share == 1.0
    assert effect.threshold_ma == pytest.approx(650.0, abs=15.0)
    assert effect.release_share * effect.threshold_ma == pytest.approx(450.0, abs=15.0)


def stop_and_go(resists_mps: Callable[[float, float], float]) -> tuple[np.ndarray, np.ndarray]:
    """Currents (N,) that are zero for half of the time, held for seconds, and true speeds (N,) of what they drive.

    `resists_mps` is what holds the machine back, for what drives it and its speed, all in m/s of steady speed.
    """
    current_ma = np.where(levels(SAMPLES, DT_S, 21, 0.0, 1.0) > 0.5, levels(SAMPLES, DT_S, 22, 60.0, 400.0), 0.0)
    each = round(DT_S / FINE_S)
    late_ma = np.concatenate([np.zeros(round(DELAY_S / FINE_S)), np.repeat(current_ma, each)])[: SAMPLES * each]
    speed_mps, speeds_mps = 0.0, []
    for drive_mps in (GAIN * lagged(late_ma, LAG_S)).tolist():
        change_mps = FINE_S / VEHICLE_S * (drive_mps - resists_mps(drive_mps, speed_mps) - speed_mps)
        speed_mps = max(speed_mps + change_mps, 0.0)
        speeds_mps.append(speed_mps)
    return current_ma, np.array(speeds_mps)[each - 1 :: each]


def shown(current_ma: np.ndarray, speed_mps: np.ndarray, **columns: np.ndarray) -> Diagnosis:
    noise_mps = 0.01 * np.random.default_rng(23).standard_normal(SAMPLES)
    held = {INPUT: current_ma, OUTPUT: speed_mps + noise_mps, **columns}
    one = Recording(DT_S * np.arange(1, SAMPLES + 1), held, DT_S, "stop and go")
    return diagnose(study([one], STRUCTURE, None, PERIOD_S))


def test_a_slope_that_a_valve_holds_downhill_is_a_grade():
    pull_mps = 0.35 * GRAVITY_MPS2 * np.sin(np.radians(PITCH))
    one = found(load_mps=-np.maximum(pull_mps, 0.0))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("grade",))
    (effect,) = one.final.explanation.effects
    assert isinstance(effect, Grade)
    assert effect.downhill_share == pytest.approx(0.0, abs=0.1)


def test_an_engine_that_only_holds_the_drive_back_below_a_speed_is_engine_speed():
    rpm = 1900.0 + wander(SAMPLES, DT_S, 15, 150.0, 5.0)
    columns = {"pitch_deg": PITCH, "engine_speed_rpm": rpm}
    gain = np.minimum(rpm / 1900.0, 1.0)
    one = diagnose(study([drive(SECONDS, 4, DT_S, 0.01, columns=columns, gain=gain)], STRUCTURE, None, PERIOD_S))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("engine_speed",))
    (effect,) = one.final.explanation.effects
    assert isinstance(effect, EngineSpeed)
    assert effect.full_rpm == pytest.approx(1900.0, abs=20.0)
    assert effect.exponent == pytest.approx(1.0, abs=0.1)


def test_a_radar_that_shows_too_much_and_nothing_at_rest_is_biased():
    current_ma, speed_mps = stop_and_go(lambda drive_mps, speed_mps: 0.0)
    one = shown(current_ma, speed_mps + 0.3 * np.tanh(speed_mps / 0.15), wheel_speed_mps=speed_mps)
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("sensor_bias",))
    (effect,) = one.final.explanation.effects
    assert isinstance(effect, SensorBias)
    assert effect.rest_share < 0.2


def test_friction_of_which_there_is_more_at_rest_is_dry_friction():
    def dry(drive_mps: float, speed_mps: float) -> float:
        return min(0.06 * (1.0 + 1.5 * math.exp(-((speed_mps / 0.12) ** 2))), drive_mps if speed_mps == 0.0 else 1.0)

    one = shown(*stop_and_go(dry))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("coulomb_friction",))
    (effect,) = one.final.explanation.effects
    assert isinstance(effect, CoulombFriction)
    assert 0.5 < effect.breakaway_share < 2.5  # 1.5, of which what holds at rest is a part
    assert 0.06 < effect.stribeck_mps < 0.24  # 0.12, likewise


def test_a_gain_about_the_current_at_which_the_drive_begins_needs_no_dead_zone_to_be_found(tmp_path):
    """Never driven below it, the drive looks as if it had an offset, which the engine speed does not scale."""
    rpm = 1800.0 + wander(SAMPLES, DT_S, 15, 150.0, 10.0)
    columns = {"pitch_deg": PITCH, "engine_speed_rpm": rpm}
    begins_ma = 450.0
    held = drive(SECONDS, 4, DT_S, 0.01, columns=columns, command=lambda u: above(u) - begins_ma, gain=rpm / 2100.0)
    held = replace(held, columns={**held.columns, INPUT: above(held.input)})
    one = diagnose(study([held], STRUCTURE, None, PERIOD_S))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("engine_speed",))
    (rest,) = (effect for effect in one.final.explanation.effects if isinstance(effect, RestCurrent))
    assert rest.rest_ma == pytest.approx(begins_ma, abs=20.0)
    assert f"beyond {rest.rest_ma:.0f} mA" in sentence(one)
    added = ladder.add(one.study, "engine_speed")
    assert added.brought_along == ("dead_zone",)
    assert [effect.name for effect in added.model.effects] == ["dead_zone", "engine_speed"]
    assert added.error_after_mps < 1.1 * 0.01
    path, floor = tmp_path / "better.yaml", ladder.floor(one.study, [held], added)
    settings.save(path, model_file(str(path), STRUCTURE, None, (), one.study, added, floor, "2026-01-01"))
    *_, step = history_of(path, files.read(path))
    assert (step.effect, step.brought_along) == ("engine_speed", ("dead_zone",))
    assert not undone(path, files.read(path)).effects


def above(current_ma: np.ndarray) -> np.ndarray:
    """Currents as they are driven above all at which the drive begins."""
    return 500.0 + 0.4 * np.abs(current_ma)
