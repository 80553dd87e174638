"""What a bar means is found from the signals alone, though the pressure shows forces that nobody recorded."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.recording import Recording
from cruise.signals import OUTPUT
from cruise.validation.line_pressure import force_of_a_bar, load_of_a_bar
from cruise.validation.told import told_shapes
from tests.validation.driving import GRAVITY_MPS2, drive, wander

DT_S, SECONDS = 0.1, 300.0
MASS_KG, KN_PER_BAR, REST_BAR, PCT_PER_BAR_MPS = 12000.0, 0.15, 40.0, 0.12


def shown(share: float = 0.0, soil_kn: float = 3.0, seed: int = 1) -> Recording:
    """Hills and soil; a pitch that shows a share of the acceleration, pressure and engine load with noise."""
    one, true = (drive(SECONDS, seed, DT_S, noise) for noise in (0.01, 0.0))
    count, rng = len(one), np.random.default_rng(seed)
    pull = GRAVITY_MPS2 * np.sin(np.radians(wander(count, DT_S, seed, 2.0, 6.0)))
    accel = np.gradient(true.output, DT_S)
    force_kn = 1e-3 * MASS_KG * (pull + accel) + wander(count, DT_S, seed + 50, soil_kn, 8.0)
    pressure_bar = REST_BAR + force_kn / KN_PER_BAR + rng.standard_normal(count)
    crop_pct = wander(count, DT_S, seed + 80, 8.0, 5.0)
    columns = {
        "pitch_deg": np.degrees(np.arcsin((pull + share * accel) / GRAVITY_MPS2)),
        "machine_mass_kg": np.full(count, MASS_KG),
        "line_pressure_bar": pressure_bar,
        "engine_load_pct": 30.0 + crop_pct + PCT_PER_BAR_MPS * (pressure_bar - REST_BAR) * true.output,
    }
    return Recording(one.time_s, {**one.columns, **columns}, DT_S, "hills.csv")


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_the_force_of_a_bar_is_found_whether_the_pitch_shows_acceleration_or_not(share):
    found = force_of_a_bar([shown(share, seed=1), shown(share, seed=2)])
    assert found is not None
    assert found.kn_per_bar == pytest.approx(KN_PER_BAR, rel=0.2)
    assert found.rest_bar == pytest.approx(REST_BAR, abs=5.0)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_load_that_a_bar_makes_is_found_beside_the_crop_in_reverse_too(way):
    one = shown()
    turned = {name: way * one.columns[name] for name in (OUTPUT, "line_pressure_bar")}
    found = load_of_a_bar([replace(one, columns={**one.columns, **turned})])
    assert found is not None
    assert found.traction_pct_per_bar_mps == pytest.approx(PCT_PER_BAR_MPS, rel=0.05)
    assert found.rest_bar == pytest.approx(REST_BAR, abs=5.0)


@pytest.mark.parametrize("of_a_bar", [force_of_a_bar, load_of_a_bar])
def test_nothing_is_said_where_the_pressure_is_not_recorded_stands_still_or_shows_something_else(of_a_bar):
    one = shown()
    noise = np.random.default_rng(0).standard_normal((2, len(one)))
    others = (
        {"line_pressure_bar": np.full(len(one), 100.0), "engine_load_pct": noise[0]},
        {"line_pressure_bar": 100.0 + noise[0], "engine_load_pct": 40.0 + noise[1]},
        {"line_pressure_bar": -one.columns["line_pressure_bar"]},  # mounted the other way round
        {"line_pressure_bar": np.full(len(one), np.nan)},
    )
    for columns in others:
        assert of_a_bar([Recording(one.time_s, {**one.columns, **columns}, DT_S, "other.csv")]) is None
    for missing in ("line_pressure_bar", "pitch_deg" if of_a_bar is force_of_a_bar else "engine_load_pct"):
        columns = {name: column for name, column in one.columns.items() if name != missing}
        assert of_a_bar([Recording(one.time_s, columns, DT_S, "other.csv")]) is None


def test_holes_are_left_out():
    one = shown()
    holed = one.columns["line_pressure_bar"].copy()
    holed[100:300] = np.nan
    speed = one.columns[OUTPUT].copy()
    speed[1000:1050] = np.nan
    found = force_of_a_bar(
        [Recording(one.time_s, {**one.columns, "line_pressure_bar": holed, OUTPUT: speed}, DT_S, "holes.csv")]
    )
    assert found is not None
    assert found.kn_per_bar == pytest.approx(KN_PER_BAR, rel=0.2)


def test_a_power_limit_may_go_by_the_pressure_or_by_the_slope_and_without_pressure_by_the_slope():
    one = shown()
    by_pressure, from_none, by_slope = map(dict, told_shapes("power_limit", [one]))
    assert from_none == by_pressure | {"rest_bar": 0.0}, "a pump holds its torque whatever the ground asks for at rest"
    assert by_pressure["kn_per_bar"] == pytest.approx(KN_PER_BAR, rel=0.2)
    assert by_slope == {"kn_per_bar": 0.0, "rest_bar": 0.0}
    bare = Recording(one.time_s, {n: c for n, c in one.columns.items() if n != "line_pressure_bar"}, DT_S, "bare.csv")
    assert tuple(map(dict, told_shapes("power_limit", [bare]))) == (by_slope,)
