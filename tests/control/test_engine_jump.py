"""An engine speed is judged by its own readings."""

import math

import pytest

from cruise.control.engine_jump import EngineJump

FRAME_S = 0.05


def read(*readings: tuple[float, float]) -> EngineJump:
    """Time in s and engine speed in 1/min."""
    engine = EngineJump(1500.0, FRAME_S)
    for time_s, engine_rpm in readings:
        engine.take(time_s, engine_rpm)
    return engine


def test_nothing_read_says_nothing():
    for engine in (read(), read((1.0, math.nan))):
        assert math.isnan(engine.rate_rpm_per_s)
        assert not engine.jumped


def test_the_rate_is_that_from_the_newest_reading_that_is_old_enough():
    assert read(*((0.02 * k, 2000.0 + 10.0 * k) for k in range(50))).rate_rpm_per_s == pytest.approx(500.0)
    assert read((0.0, 2000.0), (0.2, 1900.0)).rate_rpm_per_s == pytest.approx(500.0)
    assert read((0.0, 2000.0), (0.001, 2010.0)).rate_rpm_per_s == pytest.approx(100.0)


def test_what_may_change_grows_with_the_time_since_the_last_reading_and_is_at_least_that_of_a_frame():
    assert not read((0.0, 2000.0), (0.2, 1710.0)).jumped
    assert read((0.0, 2000.0), (0.2, 1690.0)).jumped
    assert not read((0.0, 2000.0), (0.001, 1930.0)).jumped
    assert read((0.0, 2000.0), (0.001, 1920.0)).jumped


def test_a_jump_is_believed_once_it_is_back_or_the_engine_stands_and_not_because_it_stays():
    stays = [(0.02 * k, 1450.0) for k in range(1, 500)]
    assert read((0.0, 2000.0), *stays).jumped
    assert not read((0.0, 2000.0), *stays, (10.0, 1990.0)).jumped
    assert not read((0.0, 2000.0), *stays, (10.0, 300.0)).jumped
