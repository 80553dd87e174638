"""Every entry of EFFECTS meets the same contract."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cruise.effects import EFFECTS, Stage
from cruise.signals import SIGNALS

SHAPES = {
    "saturation": {"full_stroke_ma": 1100.0, "knee_ma": 40.0},
    "dead_zone": {"threshold_ma": 350.0, "edge_ma": 20.0, "jump_share": 0.4, "release_share": 0.7},
    "quadratic_gain": {"curvature": 0.7, "bend": 0.3, "exponent": 0.8},
    "hysteresis": {"width_ma": 60.0, "share": 0.6, "closed_share": 0.8},
    "rate_limit": {"rate_ma_per_s": 700.0, "lag_s": 0.1, "return_share": 1.7},
    "engine_speed": {"exponent": 1.0, "full_rpm": 2000.0},
    "engine_droop": {"droop_share": 0.3, "onset_pct": 40.0, "filter_s": 0.6, "recovery_per_s": 0.2},
    "power_limit": {
        "power_kw": 60.0,
        "hold": 0.8,
        "follow_s": 0.5,
        "rolling_resistance": 0.08,
        "acceleration_share": 0.5,
        "filter_s": 0.7,
        "kn_per_bar": 0.1,
        "rest_bar": 20.0,
        "load_share": 0.4,
        "onset_pct": 85.0,
        "cut_per_pct_s": 0.02,
        "release_s": 1.0,
        "cutoff_bar": 150.0,
        "cut_per_bar": 0.002,
    },
    "gear_ratio": {
        "gear_1_mps": 1.4,
        "gear_2_mps": 2.5,
        "gear_3_mps": 4.4,
        "gear_4_mps": 7.8,
        "pace_exponent": 1.2,
        "shift_s": 0.6,
        "shift_loss": 0.4,
    },
    "oil_temperature": {"loss_share": 0.08, "pace_exponent": 0.4, "drag_share": 0.05, "warm_c": 45.0},
    "speed_droop": {"droop_per_mps": 0.1, "exponent": 1.6},
    "grade": {
        "mass_share": 0.6,
        "acceleration_share": 0.5,
        "filter_s": 1.0,
        "stroke_share": 0.7,
        "downhill_share": 0.4,
    },
    "rolling_resistance": {"crossover_mps": 0.3, "rise_per_mps": 0.2, "held_share": 0.3},
    "crop_load": {
        "idle_pct": 20.0,
        "rolling_pct_per_mps": 3.0,
        "inertia_pct_per_m2ps3": 6.0,
        "traction_pct_per_bar_mps": 0.2,
        "rest_bar": 20.0,
        "filter_s": 0.5,
        "crossover_mps": 0.1,
        "exponent": 1.6,
        "onset_pct": 10.0,
        "stroke_share": 0.7,
    },
    "coulomb_friction": {"crossover_mps": 0.1, "breakaway_share": 0.8, "stribeck_mps": 0.2},
    "leakage": {"exponent": 0.7, "stroke_share": 0.7, "onset_bar": 30.0, "thinning": 0.8},
    "transport_delay": {"delay_s": 0.3},
    "active_braking": {"braking_pace": 0.6, "fall_ma_per_s": 400.0, "lag_s": 0.3, "time_constant_s": 0.8},
    "resonance": {},
    "sensor_bias": {"filter_s": 4.0, "rest_share": 0.3},
    "wheel_slip": {"filter_s": 0.4},
}
DT_S = 0.2


def recording(seed: int, count: int = 60) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    rng = np.random.default_rng(seed)
    signals = {name: rng.uniform(signal.low, signal.high, count) for name, signal in SIGNALS.items()}
    signals["gear"] = rng.integers(1, 5, count).astype(float)
    return rng.uniform(-1200, 1200, count), rng.uniform(-2, 2, count), signals


@pytest.fixture(params=sorted(EFFECTS))
def effect(request):
    return EFFECTS[request.param](**SHAPES[request.param])


def test_every_effect_has_a_shape_here_and_stands_under_its_name(effect):
    assert set(SHAPES) == set(EFFECTS)
    assert EFFECTS[effect.name] is type(effect)
    assert set(effect.parameters) == {field.name for field in dataclasses.fields(effect)}


def test_needs_are_signals_that_exist(effect):
    assert set(effect.needs) <= set(SIGNALS)


def test_text_is_there_and_look_alikes_are_named(effect):
    for field in dataclasses.fields(effect.about):
        assert getattr(effect.about, field.name), field.name
    assert set(effect.about.look_alikes) <= set(EFFECTS) - {effect.name}


def test_bounds_hold_the_neutral_value(effect):
    for parameter in effect.parameters.values():
        assert parameter.low <= parameter.neutral <= parameter.high
        assert parameter.unit
        assert parameter.meaning


@pytest.mark.parametrize("holes", [False, True, "at first", "nothing known"])
@pytest.mark.parametrize("count", [60, 300])
def test_stepping_equals_the_whole_recording(effect, holes, count):
    values, speeds, signals = recording(1, count)
    if holes == "nothing known":
        for column in (values, *(signals[name] for name in effect.uses)):
            column[:] = math.nan
    elif holes == "at first":
        for k, column in enumerate((speeds, *(signals[name] for name in effect.uses))):
            column[: 3 + 2 * k] = math.nan
    elif holes:
        values[10], speeds[20] = math.nan, math.nan
        for k, name in enumerate(effect.uses):
            signals[name][30 + 3 * k : 32 + 3 * k] = math.nan
    state = effect.start(0.0)
    stepped, states = [], []
    for k, value in enumerate(values):
        now = {name: float(column[k]) for name, column in signals.items()}
        result, state = effect.step(float(value), float(speeds[k]), now, state, DT_S)
        stepped.append(result)
        states.append(state)
    whole, remembered = effect.over(values, speeds, signals, DT_S)
    np.testing.assert_allclose(np.broadcast_to(whole, values.shape), stepped, rtol=1e-12, atol=1e-12)
    if state is not None:
        np.testing.assert_allclose(np.array(remembered).T, states, rtol=1e-12, atol=1e-12)


MIRRORED = ("ground_speed_mps", "wheel_speed_mps", "pitch_deg", "line_pressure_bar")  # what changes its sign in reverse
ONE_WAY = {"grade": "slower than 0.05 m/s, a machine counts as one that goes forward"}  # not odd while it turns round


def drive(one_way: bool) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Currents in mA, speeds in m/s and signals (200,) of a machine that goes to and fro, or forward alone."""
    rng, time_s = np.random.default_rng(8), DT_S * np.arange(200)
    speeds = (1.5 if one_way else 0.0) + np.sin(0.5 * time_s) + 0.1 * rng.standard_normal(200)
    currents = 500.0 * np.roll(speeds, -2) + 20.0 * rng.standard_normal(200)
    _, _, signals = recording(8, 200)
    signals |= {
        "ground_speed_mps": speeds + 0.05 * rng.standard_normal(200),
        "wheel_speed_mps": 1.1 * speeds,
        "pitch_deg": 6.0 * np.sin(0.17 * time_s),
        "line_pressure_bar": 150.0 * np.sin(0.3 * time_s + 0.4) + 100.0 * np.sign(speeds),
    }
    return currents, speeds, signals


def test_in_reverse_it_is_the_mirror_image(effect):
    currents, speeds, signals = drive(effect.name in ONE_WAY)
    turned = {name: -column if name in MIRRORED else column for name, column in signals.items()}
    way = 1.0 if effect.acts_as is Stage.GAIN else -1.0
    values = np.ones(200) if effect.acts_as is Stage.GAIN else currents
    result, state = effect.over(values, speeds, signals, DT_S)
    other, other_state = effect.over(way * values, -speeds, turned, DT_S)
    np.testing.assert_allclose(other, way * result, rtol=1e-9, atol=1e-9)
    paces = [np.broadcast_to(effect.pace(*seen), 200) for seen in ((signals, state), (turned, other_state))]
    np.testing.assert_allclose(*paces, rtol=1e-9)


def test_whether_it_reads_the_speed_is_said_truly(effect):
    values, speeds, signals = recording(4)
    (result, state), (other, other_state) = (effect.over(values, s, signals, DT_S) for s in (speeds, -1.7 * speeds))
    paces = effect.pace(signals, state), effect.pace(signals, other_state)
    same = np.array_equal(result, other) and np.array_equal(*paces)
    assert effect.reads_speed is not same


def test_inputs_are_untouched(effect):
    values, speeds, signals = recording(2)
    before = values.copy(), speeds.copy(), {name: column.copy() for name, column in signals.items()}
    effect.over(values, speeds, signals, DT_S)
    effect.pace(signals, effect.start(0.0))
    np.testing.assert_array_equal(values, before[0])
    np.testing.assert_array_equal(speeds, before[1])
    for name, column in signals.items():
        np.testing.assert_array_equal(column, before[2][name])


def test_neutral_parameters_remove_the_effect(effect):
    neutral = type(effect)(**{name: parameter.neutral for name, parameter in effect.parameters.items()})
    values, speeds, signals = recording(3)
    result, state = neutral.over(values, speeds, signals, DT_S)
    if neutral.acts_as is not Stage.LOAD:  # a load's coefficient is linear: zero removes it, whatever its shape
        np.testing.assert_allclose(result, values, rtol=1e-12)
    np.testing.assert_allclose(neutral.pace(signals, state), 1.0, rtol=1e-12)


def test_an_unmeasured_signal_gives_no_number(effect):
    for name in effect.needs:
        now = dict.fromkeys(effect.needs, 1.0) | {name: math.nan}
        result, _ = effect.step(1.0, 0.0, now, effect.start(0.0), DT_S)
        assert math.isnan(result)


def test_it_acts_at_a_place_of_the_equation(effect):
    assert effect.acts_as in set(Stage) - {Stage.SENSOR}
    assert effect.acts_as is effect.stage or effect.stage is Stage.SENSOR


def test_floats_give_floats_and_start_points_are_stepped_side_by_side(effect):
    values, speeds, signals = recording(5, 12)
    state, many = effect.start(0.0), effect.start(np.zeros(3))
    for k in range(0, 12, 3):
        three = slice(k, k + 3)
        columns = {name: column[three] for name, column in signals.items()}
        results, many = effect.step(values[three], speeds[three], columns, many, DT_S)
        paces = effect.pace(columns, many)
        now = {name: float(column[k]) for name, column in signals.items()}
        result, state = effect.step(float(values[k]), float(speeds[k]), now, state, DT_S)
        pace = effect.pace(now, state)
        assert isinstance(result, float)
        assert isinstance(pace, float)
        assert np.broadcast_to(results, 3)[0] == pytest.approx(result, rel=1e-12)
        assert np.broadcast_to(paces, 3)[0] == pytest.approx(pace, rel=1e-12)


def test_several_shapes_are_stepped_at_once(effect):
    neutral = {name: parameter.neutral for name, parameter in effect.parameters.items()}
    shapes = [SHAPES[effect.name], neutral]
    kind = type(effect)
    both = kind(**{name: np.array([[shape[name]] for shape in shapes]) for name in neutral})
    values, speeds, signals = recording(6, 20)
    states = [one.start(values[:5] * 0.0) for one in (both, *(kind(**shape) for shape in shapes))]
    for k in range(0, 20, 5):
        five = slice(k, k + 5)
        columns = {name: column[five] for name, column in signals.items()}
        found = []
        for i, one in enumerate((both, *(kind(**shape) for shape in shapes))):
            result, states[i] = one.step(values[five], speeds[five], columns, states[i], DT_S)
            found.append((result, one.pace(columns, states[i])))
        for j in (0, 1):
            together, *alone = (pair[j] for pair in found)
            alone = [np.broadcast_to(one, 5) for one in alone]
            np.testing.assert_allclose(np.broadcast_to(together, (2, 5)), alone, rtol=1e-12)


def test_a_hole_in_the_recording_is_not_remembered(effect):
    values, speeds, signals = recording(7)
    values[20], speeds[25] = math.nan, math.nan
    for name in effect.needs:
        signals[name][30] = math.nan
    result, state = effect.over(values, speeds, signals, DT_S)
    holes = {20, 25, 30}
    kept = [k for k in range(60) if k not in holes]
    assert np.isfinite(np.broadcast_to(result, 60)[kept]).all()
    assert np.isfinite(np.broadcast_to(effect.pace(signals, state), 60)[kept]).all()


def test_an_effect_is_frozen(effect):
    name = next(iter(effect.parameters), "anything")
    with pytest.raises((dataclasses.FrozenInstanceError, TypeError)):  # the latter where there is no field at all
        setattr(effect, name, 1.0)


COMMAND = sorted(name for name, kind in EFFECTS.items() if kind.stage is Stage.COMMAND)


@pytest.mark.parametrize("name", COMMAND)
@given(current_ma=st.floats(-1200, 1200), share=st.floats(0, 1))
@example(current_ma=478.0, share=0.012)  # rounded to just beyond the stop
@example(current_ma=5e-324, share=0.0)  # nothing is left of it once it is divided
@example(current_ma=-1e-300, share=1.0)
def test_the_inverse_undoes_the_effect(name, current_ma, share):
    bounds = EFFECTS[name].parameters
    effect = EFFECTS[name](**{key: bound.low + share * (bound.high - bound.low) for key, bound in bounds.items()})
    value, _ = effect.step(current_ma, 0.0, {}, effect.start(0.0), DT_S)
    inverse = effect.inverse(value, {}, effect.start(0.0))
    if inverse.refused:
        pytest.fail(f"a value that the effect gives must have an inverse: {inverse.refused}")
    again, more, less = (
        effect.step(one, 0.0, {}, effect.start(0.0), DT_S)[0]
        for one in (inverse.nearest(current_ma), current_ma + 0.5, current_ma - 0.5)
    )
    assert again == pytest.approx(value, abs=1e-6)
    spare_ma = 1e-6 + 1e-10 / max(abs(more - less), 1e-15)  # near a stop a rounding of the value is many of the current
    assert inverse.low - spare_ma <= current_ma <= inverse.high + spare_ma
