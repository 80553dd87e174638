"""The undulation of the ground: its size, its reproducibility, and that machine and pitch sensor meet it."""

import numpy as np
import pytest
from msgspec import structs

from cruise.plant import Combine, Inputs, PlantSettings
from cruise.plant.road import Road, RoadSettings
from cruise.plant.settings import EffectFactors

ROUGH = RoadSettings(undulation_deg=0.4)


def test_slopes_have_the_stated_size_over_a_long_way():
    for seed in range(5):
        road = Road.of(ROUGH, seed)
        slopes = np.array([road.slope_deg(x) for x in np.arange(0.0, 5000.0, 0.5)])
        assert slopes.std() == pytest.approx(0.4, rel=0.05)
        assert abs(slopes.mean()) < 0.02


def test_no_wave_is_shorter_than_the_wheelbase_or_longer_than_stated():
    road = Road.of(ROUGH, 1)
    x = np.arange(0.0, 4096.0, 0.25)
    power = np.abs(np.fft.rfft([road.slope_deg(one) for one in x])) ** 2
    per_m = np.fft.rfftfreq(len(x), 0.25)
    inside = (per_m > 0.95 / 60.0) & (per_m < 1.05 / 4.0)
    assert power[inside].sum() > 0.99 * power.sum()


def test_equal_seeds_give_equal_ground_and_others_another():
    assert Road.of(ROUGH, 3).slope_deg(17.0) == Road.of(ROUGH, 3).slope_deg(17.0)
    assert Road.of(ROUGH, 3).slope_deg(17.0) != Road.of(ROUGH, 4).slope_deg(17.0)


def driven(settings: PlantSettings, seconds: float = 20.0) -> tuple[Combine, list[float]]:
    combine, slopes = Combine(settings, 5), []
    for k in range(round(seconds)):
        combine.advance(Inputs(900.0), k + 1.0)
        slopes.append(combine.truth.grade_deg)
    return combine, slopes


def test_the_machine_meets_the_slope_of_where_it_is():
    combine, slopes = driven(PlantSettings(road=ROUGH))
    travel_m = combine.state.travel_m
    assert travel_m == pytest.approx(20.0 * combine.truth.ground_speed_mps, rel=0.15)
    assert slopes[-1] == Road.of(ROUGH, 5).slope_deg(travel_m)
    assert np.ptp(slopes) > 0.3


def test_level_ground_is_the_default_and_the_factor_of_grade_switches_undulation_off():
    assert set(driven(PlantSettings(), 5.0)[1]) == {0.0}
    off = PlantSettings(road=ROUGH, effects=structs.replace(EffectFactors(), grade=0.0))
    assert set(driven(off, 5.0)[1]) == {0.0}


def test_speed_falls_uphill():
    smooth, rough = driven(PlantSettings()), driven(PlantSettings(road=RoadSettings(undulation_deg=3.0)))
    assert abs(smooth[0].truth.ground_speed_mps - rough[0].truth.ground_speed_mps) > 0.005
