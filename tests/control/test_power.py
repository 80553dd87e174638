"""The guard gives way to an overloaded engine or line, comes back slowly, and does nothing without a measurement."""

import math

import pytest

from cruise.control.power import PowerGuard, PowerSettings

FRAME_S = 0.05


def run(
    guard: PowerGuard, load_pct: float, seconds: float, engine_rpm: float | None = None, bar: float = math.nan
) -> float:
    found = math.nan
    rpm = engine_rpm or (1700.0 if load_pct > 96.0 else 2100.0)
    for _ in range(round(seconds / FRAME_S)):
        guard.watch(load_pct, rpm)
        found = guard.step(rpm, bar, 1.5, 1.6)
    return found


def test_with_power_left_or_no_measurement_the_setpoint_stays():
    for load_pct in (50.0, 96.0, math.nan):
        assert run(PowerGuard(PowerSettings(), FRAME_S), load_pct, 5.0) == 1.6


def test_an_overload_takes_the_setpoint_below_the_speed_at_its_rate():
    guard = PowerGuard(PowerSettings(), FRAME_S)
    run(guard, 80.0, 2.0)
    run(guard, 105.0, 1.0)
    before = guard.cap_mps
    assert before < 1.5
    assert before - run(guard, 105.0, 1.0) == pytest.approx(0.4)


def test_it_comes_back_slowly_and_ends():
    guard = PowerGuard(PowerSettings(), FRAME_S)
    run(guard, 80.0, 2.0)
    run(guard, 105.0, 2.0)
    low = guard.cap_mps
    assert run(guard, 97.0, 3.0) <= low  # neither over nor under: it holds, but for the lag of the load
    held = guard.cap_mps
    assert run(guard, 50.0, 2.0) == pytest.approx(held + 0.1, abs=0.02)  # the lag of the load, on the way down
    assert run(guard, 50.0, 30.0) == 1.6
    assert guard.cap_mps == math.inf


def test_a_lost_load_does_not_hold_the_machine_back_forever():
    guard = PowerGuard(PowerSettings(), FRAME_S)
    run(guard, 80.0, 2.0)
    run(guard, 105.0, 2.0)
    assert run(guard, math.nan, 60.0) == 1.6


def test_an_engine_that_lugs_a_little_carries_on_and_the_drive_slows_down_with_it():
    guard = PowerGuard(PowerSettings(), FRAME_S)
    run(guard, 80.0, 2.0)
    assert run(guard, 105.0, 10.0, 2060.0) == 1.6
    assert not guard.limiting
    assert run(guard, 105.0, 10.0, 2000.0) == pytest.approx(1.6 * 2000.0 / (0.97 * 2100.0))
    assert guard.limiting
    assert run(guard, 50.0, 1.0, 2000.0) == 1.6
    assert run(guard, 105.0, 3.0, 1800.0) < 1.5


def test_a_load_that_comes_at_once_is_met_before_the_engine_has_lost_a_fifth_of_its_speed():
    """A plugged drum: within 0.4 s the engine loses 240 rpm and has power left all that time, then 170 rpm a second."""
    guard = PowerGuard(PowerSettings(), FRAME_S)
    run(guard, 15.0, 3.0, 2090.0)
    for k in range(8):
        run(guard, 15.0 + 10.0 * k, FRAME_S, 2090.0 - 30.0 * k)
    rpm = 1850.0
    while run(guard, 99.5, FRAME_S, rpm) == 1.6:
        rpm -= 170.0 * FRAME_S
    assert 1750.0 < rpm < 1800.0


def test_an_engine_that_is_freed_gets_its_own_speed_back_and_no_more():
    guard = PowerGuard(PowerSettings(), FRAME_S)
    run(guard, 40.0, 3.0, 2100.0)
    assert guard.regains(1900.0) is None
    run(guard, 99.5, 3.0, 1600.0)
    assert guard.regains(1600.0) == pytest.approx(math.log(2100.0 / 1600.0))
    assert guard.regains(2150.0) == 0.0
    assert guard.regains(math.nan) is None


def test_an_engine_that_is_throttled_back_is_not_lugged():
    guard = PowerGuard(PowerSettings(), FRAME_S)
    run(guard, 40.0, 3.0, 2100.0)
    for k in range(80):
        run(guard, 40.0, FRAME_S, 2100.0 - 7.0 * k)  # 140 rpm/s
    assert run(guard, 99.5, 3.0, 1540.0) == 1.6


def test_an_engine_that_sags_under_its_load_was_not_throttled_back():
    guard = PowerGuard(PowerSettings(), FRAME_S)
    run(guard, 40.0, 3.0, 2100.0)
    for k in range(10):
        run(guard, 85.0, FRAME_S, 2100.0 - 20.0 * k)  # 400 rpm/s
    assert guard.unloaded_rpm == pytest.approx(2100.0 - 10 * FRAME_S * 20.0, abs=1.0)


def test_an_open_relief_valve_holds_the_setpoint_at_the_speed_until_there_is_force_again():
    guard = PowerGuard(PowerSettings(), FRAME_S)
    assert run(guard, 50.0, 1.0, bar=375.0) == 1.6
    assert run(guard, 50.0, 1.0, bar=400.0) == 1.5
    assert guard.limiting
    assert run(guard, 50.0, 1.0, bar=350.0) == 1.5
    assert run(guard, 50.0, 1.0, bar=330.0) == 1.6
    assert not guard.limiting
    run(guard, 50.0, 1.0, bar=400.0)
    assert run(guard, 50.0, 1.0) == 1.6


def test_what_the_last_drive_met_is_over_at_the_next():
    guard = PowerGuard(PowerSettings(), FRAME_S)
    run(guard, 80.0, 2.0)
    assert run(guard, 105.0, 3.0, 1700.0) < 1.5
    for _ in range(60):
        guard.watch(50.0, 1700.0)  # a person drives, and throttles back
    guard.restart()
    assert not guard.limiting
    assert run(guard, 50.0, FRAME_S, 1700.0) == 1.6
    assert run(guard, 99.5, 3.0, 1690.0) == 1.6, "it lugs from here"


@pytest.mark.parametrize("load_pct", [90.0, 96.0, 99.5])
def test_an_overload_that_is_older_than_the_drive_is_borne_no_longer(load_pct):
    """The engine lost its speed while a person drove: taken for its own, no sag would ever be seen."""
    guard = PowerGuard(PowerSettings(), FRAME_S)
    for _ in range(40):
        guard.watch(load_pct, 2100.0)
    for _ in range(40):
        guard.watch(99.5, 1800.0)
    guard.restart()
    assert run(guard, 99.5, 2.0, 1750.0) < 1.0
