"""Crop load, by hand and in a model."""

import math

import pytest

from cruise.effects.crop_load import CropLoad
from cruise.model.model import Model


def phi(speed_mps):
    return CropLoad(crossover_mps=0.1).step(0.0, speed_mps, {"engine_load_pct": 80.0}, (speed_mps, 0.8, 0.0), 0.2)[0]


def test_full_load_costs_the_coefficient():
    assert CropLoad().step(0.0, 2.0, {"engine_load_pct": 100.0}, CropLoad().start(0.0), 0.2)[0] == pytest.approx(-1.0)
    model = Model(0.2, 0, 1, 0, (CropLoad(),), (1e-3, 0.3, 0.0))
    lost = [
        model.predict(model.start(1.0, 900.0, now), [900.0], [now])[0]
        for now in ({"engine_load_pct": 20.0}, {"engine_load_pct": 80.0})
    ]
    assert lost[0] - lost[1] == pytest.approx(0.3 * 0.6, rel=1e-3)


def test_it_holds_the_machine_back_whichever_way_it_goes_and_moves_none_that_stands():
    assert phi(1.0) == pytest.approx(-0.8)
    assert phi(-1.0) == pytest.approx(0.8)
    assert phi(0.0) == 0.0


def test_what_the_drive_itself_takes_from_the_engine_is_no_crop():
    effect, now = CropLoad(rolling_pct_per_mps=4.0, inertia_pct_per_m2ps3=6.0), {"engine_load_pct": 26.0}
    steady, state = effect.step(0.0, 2.0, now, effect.start(0.0), 0.2)
    assert steady == pytest.approx(-(26.0 - 4.0 * 2.0) / 100.0)
    speeding_up, _ = effect.step(0.0, 2.1, now, state, 0.2)
    assert speeding_up == pytest.approx(-(26.0 - 2.1 * (4.0 + 6.0 * 0.5)) / 100.0)


def test_what_engine_and_drum_take_while_nothing_is_cut_is_no_crop():
    effect = CropLoad(idle_pct=30.0)
    assert effect.step(0.0, 2.0, {"engine_load_pct": 30.0}, effect.start(0.0), 0.2)[0] == 0.0
    assert effect.step(0.0, 2.0, {"engine_load_pct": 80.0}, effect.start(0.0), 0.2)[0] == pytest.approx(-0.5)


def test_what_the_pressure_of_the_drive_takes_from_the_engine_is_no_crop():
    effect = CropLoad(traction_pct_per_bar_mps=0.1, rest_bar=20.0)
    start = effect.start(0.0)
    now = {"engine_load_pct": 50.0, "line_pressure_bar": 120.0}
    assert effect.step(0.0, 2.0, now, start, 0.2)[0] == pytest.approx(-(50.0 - 0.1 * 100.0 * 2.0) / 100.0)
    for pressure in ({}, {"line_pressure_bar": math.nan}):  # not measured: all of it counts
        assert effect.step(0.0, 2.0, {"engine_load_pct": 50.0} | pressure, start, 0.2)[0] == pytest.approx(-0.5)


@pytest.mark.parametrize("speed_mps", [2.0, -2.0])
def test_the_drive_s_own_power_is_none_of_the_crop_s_in_reverse_either(speed_mps):
    effect = CropLoad(
        idle_pct=10.0,
        rolling_pct_per_mps=4.0,
        inertia_pct_per_m2ps3=6.0,
        traction_pct_per_bar_mps=0.1,
        rest_bar=20.0,
    )
    forward, accel_mps2 = math.copysign(1.0, speed_mps), math.copysign(0.5, speed_mps)  # quicker, whichever way
    own_pct = 10.0 + 4.0 * 2.0 + 6.0 * 2.0 * 0.5 + 0.1 * (120.0 - 20.0) * 2.0
    now = {"engine_load_pct": own_pct + 30.0, "line_pressure_bar": forward * 120.0}
    before = (speed_mps - 0.2 * accel_mps2, math.nan, forward)
    assert effect.step(0.0, speed_mps, now, before, 0.2)[0] == pytest.approx(-forward * 0.3)


def test_the_crop_is_felt_through_a_lag():
    effect = CropLoad(filter_s=1.0)
    _, state = effect.step(0.0, 2.0, {"engine_load_pct": 0.0}, effect.start(0.0), 0.2)
    for _ in range(4):
        _, state = effect.step(0.0, 2.0, {"engine_load_pct": 100.0}, state, 0.2)
    felt, _ = effect.step(0.0, 2.0, {"engine_load_pct": 100.0}, state, 0.2)
    assert felt == pytest.approx(-(1.0 - math.exp(-1.0)))


@pytest.mark.parametrize(("load_pct", "felt"), [(30.0, 0.3), (60.0, 1.2), (15.0, 0.075)])
def test_an_engine_that_lugs_feels_a_power_of_the_load(load_pct, felt):
    effect = CropLoad(exponent=2.0)
    assert effect.step(0.0, 2.0, {"engine_load_pct": load_pct}, effect.start(0.0), 0.2)[0] == pytest.approx(-felt)


@pytest.mark.parametrize(("load_pct", "felt"), [(50.0, 0.0), (60.0, 0.0), (85.0, 0.25)])
def test_a_governor_may_take_load_without_giving_way(load_pct, felt):
    effect = CropLoad(onset_pct=60.0)
    assert -effect.step(0.0, 2.0, {"engine_load_pct": load_pct}, effect.start(0.0), 0.2)[0] == pytest.approx(felt)
    unknown = effect.step(0.0, 2.0, {"engine_load_pct": math.nan}, effect.start(0.0), 0.2)[0]
    assert math.isnan(unknown)


@pytest.mark.parametrize(
    ("share", "speed_mps", "factor"), [(0.0, 3.0, 1.0), (0.5, 3.0, 1.5), (1.0, -3.0, -2.0), (1.0, 0.75, 0.5)]
)
def test_a_pump_that_turns_more_slowly_with_the_engine_loses_more_at_a_great_stroke(share, speed_mps, factor):
    effect = CropLoad(crossover_mps=0.01, stroke_share=share)
    phi, _ = effect.step(0.0, speed_mps, {"engine_load_pct": 30.0}, effect.start(0.0), 0.2)
    assert phi == pytest.approx(-0.3 * factor)
