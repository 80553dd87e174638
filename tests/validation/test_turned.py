"""An engine that the wheels turn is told from one whose turns per metre the current sets."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.recording import Recording
from cruise.validation.complete import complete, why_left_out
from cruise.validation.turned import ENGINE, engine_is_turned
from tests.validation.driving import drive, wander

DT_S, SECONDS = 0.1, 240.0
SAMPLES = round(SECONDS / DT_S)
THROTTLE_RPM = 1800.0 + wander(SAMPLES, DT_S, 1, 250.0, 8.0)
PEDAL_TO_SPEED_S = 12.0  # a car that coasts


def hydrostatic(seed: int = 3, **options) -> Recording:
    """A pump that the engine turns: its speed is a factor of the ground speed."""
    return drive(SECONDS, seed, DT_S, gain=THROTTLE_RPM / 2100.0, columns={"engine_speed_rpm": THROTTLE_RPM}, **options)


def car(seed: int = 3) -> Recording:
    """Gears that are changed at 2500 and 1200 rpm, of which no column tells; the clutch is never seen."""
    one = drive(SECONDS, seed, DT_S, vehicle_s=PEDAL_TO_SPEED_S)
    speed = np.clip(20.0 * (one.output - one.output.min()) + 1.0, 1.0, None)
    ratios, gear, engine_rpm = (370.0, 205.0, 133.0, 97.0, 75.0), 0, np.zeros(len(speed))
    for k, v in enumerate(speed):
        if ratios[gear] * v > 2500.0 and gear < 4:
            gear += 1
        elif ratios[gear] * v < 1200.0 and gear > 0:
            gear -= 1
        engine_rpm[k] = ratios[gear] * v
    columns = {**one.columns, "ground_speed_mps": speed, "engine_speed_rpm": engine_rpm}
    return replace(one, columns={**columns, "engine_load_pct": 50.0 + wander(len(speed), DT_S, 4, 10.0, 2.0)})


def test_the_engine_of_a_car_is_turned_by_its_wheels_and_no_cause():
    assert engine_is_turned([car()])
    [kept] = complete([car()], ())
    assert not set(ENGINE) & set(kept.columns)
    assert why_left_out("engine_speed_rpm", [kept]).startswith("the wheels turn the engine")


def test_what_the_model_needs_is_kept():
    assert "engine_speed_rpm" in complete([car()], ("engine_speed_rpm",))[0].columns


HYDROSTATIC = {
    "as it is": {},
    "hills of a fifth of the speed": {"load_mps": wander(SAMPLES, DT_S, 5, 0.3, 10.0)},
    "a dead zone of a third": {"command": lambda u: np.maximum(u - 300.0, 0.0)},
    "heavy": {"vehicle_s": 2.5},
}


@pytest.mark.parametrize("machine", HYDROSTATIC)
def test_the_engine_of_a_hydrostatic_drive_is_a_cause(machine):
    one = hydrostatic(**HYDROSTATIC[machine])
    assert not engine_is_turned([one])
    assert "engine_speed_rpm" in complete([one], ())[0].columns


def test_a_current_that_is_held_while_the_throttle_moves_does_not_make_it_a_consequence():
    held = replace(hydrostatic(), columns={**hydrostatic().columns, "pump_current_ma": np.full(SAMPLES, 600.0)})
    speed = 1.5 * THROTTLE_RPM / 2100.0 + np.random.default_rng(1).normal(0.0, 0.05, SAMPLES)
    assert not engine_is_turned([replace(held, columns={**held.columns, "ground_speed_mps": speed})])


def test_an_engine_that_is_not_recorded_or_stands_is_not_turned():
    still = drive(SECONDS, 3, DT_S, columns={"engine_speed_rpm": np.zeros(SAMPLES)})
    assert not engine_is_turned([drive(SECONDS, 3, DT_S)])
    assert not engine_is_turned([still])
