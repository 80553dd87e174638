"""Effects in other forms than the usual one: a detent, oil that slows the servo, a spool that sticks."""

import numpy as np
import pytest

from cruise.effects.dead_zone import DeadZone
from cruise.effects.oil_temperature import OilTemperature
from cruise.validation.diagnose import Verdict, diagnose
from cruise.validation.study import study
from tests.validation.diagnosing import DT_S, PERIOD_S, PITCH, SAMPLES, SECONDS, STRUCTURE, found
from tests.validation.driving import drive, wander


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
