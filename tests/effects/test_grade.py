"""Grade, by hand."""

import math

import numpy as np
import pytest

from cruise.effects.grade import Grade
from cruise.identification.regressors import checked_signals
from cruise.model.model import Model
from cruise.recording import Recording


def phi(effect, **signals):
    return effect.step(0.0, 1.0, signals, effect.start(0.0), 0.2)[0]


def test_thirty_degrees_uphill_pull_back_with_half_the_weight():
    assert phi(Grade(), pitch_deg=30.0) == pytest.approx(-4.905)
    assert phi(Grade(), pitch_deg=-30.0) == pytest.approx(4.905)


@pytest.mark.parametrize(("share", "factor"), [(0.0, 1.0), (0.5, 1.2), (1.0, 1.4)])
def test_a_heavier_machine_loses_more_by_the_share(share, factor):
    level = phi(Grade(), pitch_deg=3.0)
    assert phi(Grade(mass_share=share), pitch_deg=3.0, machine_mass_kg=21000.0) == pytest.approx(factor * level)


def test_a_mass_that_is_not_measured_is_that_of_the_empty_machine():
    heavy = Grade(mass_share=1.0)
    assert (
        phi(heavy, pitch_deg=3.0, machine_mass_kg=math.nan) == phi(heavy, pitch_deg=3.0) == phi(Grade(), pitch_deg=3.0)
    )
    both = phi(heavy, pitch_deg=np.full(2, 3.0), machine_mass_kg=np.array([math.nan, 30000.0]))
    np.testing.assert_allclose(both, [phi(Grade(), pitch_deg=3.0), 2 * phi(Grade(), pitch_deg=3.0)])


@pytest.mark.parametrize(("share", "speed_mps", "factor"), [(0.0, 3.0, 1.0), (0.5, 3.0, 1.5), (1.0, 0.75, 0.5)])
def test_a_pump_that_gives_up_stroke_loses_more_at_a_great_one(share, speed_mps, factor):
    effect, signals = Grade(stroke_share=share), {"pitch_deg": 3.0, "ground_speed_mps": speed_mps}
    unknown, state = effect.step(0.0, 9.0, signals, effect.start(0.0), 0.2)
    assert unknown == phi(Grade(), pitch_deg=3.0)  # no speed has been measured yet
    assert effect.step(0.0, 9.0, signals, state, 0.2)[0] == pytest.approx(factor * unknown)


@pytest.mark.parametrize(("share", "left"), [(1.0, 0.0), (0.0, 0.8)])
def test_on_level_ground_a_pitch_that_is_all_acceleration_is_no_slope(share, left):
    effect, accel_mps2, dt_s = Grade(acceleration_share=share, filter_s=1.0), 0.8, 0.2
    pitch_deg = math.degrees(math.asin(accel_mps2 / 9.81))
    pull, state = 0.0, effect.start(0.0)
    for k in range(60):
        signals = {"pitch_deg": pitch_deg, "ground_speed_mps": accel_mps2 * dt_s * k}
        pull, state = effect.step(0.0, 0.0, signals, state, dt_s)
    assert pull == pytest.approx(-left, abs=1e-3)


def test_the_speed_of_the_sample_itself_is_not_in_it():
    effect = Grade(acceleration_share=1.0, filter_s=0.5)
    state = effect.start(0.0)
    for speed in (1.0, 1.1, 1.2):
        _, state = effect.step(0.0, 0.0, {"pitch_deg": 1.0, "ground_speed_mps": speed}, state, 0.2)
    pulls = {effect.step(0.0, 0.0, {"pitch_deg": 1.0, "ground_speed_mps": v}, state, 0.2)[0] for v in (0.0, 5.0)}
    assert len(pulls) == 1


@pytest.mark.parametrize("further", [("machine_mass_kg",), ()])
def test_a_recorded_mass_is_used_and_one_that_is_not_recorded_is_not_missed(further):
    names = ("pump_current_ma", "ground_speed_mps", "pitch_deg", *further)
    recording = Recording(0.2 * np.arange(9), {name: np.ones(9) for name in names}, 0.2, "test")
    model = Model(0.2, 1, 1, 0, (Grade(),), (0.5, 1e-3, 0.1, 0.0))
    assert set(checked_signals(model, recording)) == {"pitch_deg", "ground_speed_mps", *further}


@pytest.mark.parametrize(
    ("speed_mps", "held_at"),
    [(2.0, -30.0), (0.0, -30.0), (-0.02, -30.0), (math.nan, -30.0), (-2.0, 30.0)],  # 0.02 m/s is noise at a standstill
)
def test_a_valve_may_hold_the_machine_downhill_whichever_way_it_goes(speed_mps, held_at):
    effect = Grade(downhill_share=0.2)
    for pitch_deg in (30.0, -30.0):
        signals = {"pitch_deg": pitch_deg, "ground_speed_mps": speed_mps}
        _, state = effect.step(0.0, 9.0, signals, effect.start(0.0), 0.2)
        left = 0.2 if pitch_deg == held_at else 1.0
        assert effect.step(0.0, 9.0, signals, state, 0.2)[0] == pytest.approx(-left * math.copysign(4.905, pitch_deg))
    recorded = {"pitch_deg": np.repeat([30.0, -30.0], 4), "ground_speed_mps": np.full(8, speed_mps)}
    whole, _ = effect.over(0.0, recorded["ground_speed_mps"], recorded, 0.2)
    expected = [-left * 4.905 for left in ((0.2, -1.0) if held_at > 0.0 else (1.0, -0.2))]
    np.testing.assert_allclose(whole[[3, 7]], expected)
