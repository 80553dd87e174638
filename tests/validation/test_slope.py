"""A pitch sensor that shows acceleration is found out from pitch and speed alone, and its slope is put right."""

import numpy as np
import pytest

from cruise.recording import Recording
from cruise.signals import OUTPUT
from cruise.validation.slope import PITCH, pitch_share, slope_deg
from tests.validation.driving import GRAVITY_MPS2, drive, wander

DT_S = 0.1


def shown(share: float, seed: int = 1, noise_deg: float = 0.1, noise_mps: float = 0.01) -> tuple[Recording, np.ndarray]:
    """A drive over hills and the slope (N,) in degrees behind its pitch."""
    one = drive(200.0, seed, DT_S, noise_mps)
    true = drive(200.0, seed, DT_S, 0.0).output
    slope = wander(len(one), DT_S, seed, 2.0, 6.0)
    accel = np.gradient(true, DT_S)
    pull = GRAVITY_MPS2 * np.sin(np.radians(slope)) + share * accel
    pitch = np.degrees(np.arcsin(pull / GRAVITY_MPS2)) + noise_deg * np.random.default_rng(seed).standard_normal(
        len(one)
    )
    return Recording(one.time_s, {**one.columns, PITCH: pitch}, DT_S, "hills.csv"), slope


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_share_of_acceleration_is_found(share):
    found = [pitch_share([shown(share, seed)[0]]) for seed in range(4)]
    assert np.mean(found) == pytest.approx(share, abs=0.06)
    assert pitch_share([shown(share, seed)[0] for seed in range(4)]) == pytest.approx(np.mean(found), abs=0.04)


@pytest.mark.parametrize(("share", "bound"), [(1.6, 1.0), (-0.7, 0.0)])
def test_it_stays_what_a_sensor_can_do(share, bound):
    assert pitch_share([shown(share)[0]]) == bound


def test_of_hills_that_differ_between_recordings_only_what_moves_counts():
    (one, _), (other, _) = shown(0.5, 1), shown(0.5, 2)
    lifted = Recording(other.time_s, {**other.columns, PITCH: other.columns[PITCH] + 8.0}, DT_S, "lifted.csv")
    assert pitch_share([one, lifted]) == pytest.approx(pitch_share([one, other]), abs=0.02)


def test_a_sensor_that_is_mounted_askew_shows_no_acceleration():
    time_s = DT_S * np.arange(1, 1001)
    columns = {"pump_current_ma": time_s, OUTPUT: 0.02 * time_s + 0.1 * np.sin(time_s), PITCH: np.full(1000, 5.0)}
    assert pitch_share([Recording(time_s, columns, DT_S, "askew.csv")]) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_slope_is_what_is_left_of_the_pitch(share):
    one, slope = shown(share)
    found = slope_deg(one, share)
    assert np.std(found - slope) < 0.2
    assert abs(np.mean(found - slope)) < 0.05
    if share == 1.0:
        assert np.std(slope_deg(one, 0.0) - slope) > 1.0


def test_a_still_machine_shows_the_slope_itself():
    time_s = DT_S * np.arange(1, 101)
    columns = {"pump_current_ma": time_s, OUTPUT: np.full(100, 1.2), PITCH: np.full(100, 4.0)}
    one = Recording(time_s, columns, DT_S, "still.csv")
    assert pitch_share([one]) == 0.0
    assert slope_deg(one, 1.0) == pytest.approx(np.full(100, 4.0), abs=1e-9)


def test_holes_cost_the_second_about_them_and_no_share():
    one, _ = shown(1.0)
    for name in (PITCH, OUTPUT):
        values = np.array(one.columns[name])
        values[700:703] = np.nan
        holed = Recording(one.time_s, {**one.columns, name: values}, DT_S, "holes.csv")
        found, whole = slope_deg(holed, 1.0), slope_deg(one, 1.0)
        lost = np.flatnonzero(np.isnan(found))
        assert len(lost)
        assert lost.min() >= 695
        assert lost.max() <= 707
        assert found[np.isfinite(found)] == pytest.approx(whole[np.isfinite(found)], abs=1e-9)
        assert pitch_share([holed]) == pytest.approx(pitch_share([one]), abs=0.02)
    nothing = Recording(one.time_s, {**one.columns, PITCH: np.full(len(one), np.nan)}, DT_S, "no pitch.csv")
    assert pitch_share([nothing]) == 0.0
    assert pitch_share([nothing, one]) == pitch_share([one])
