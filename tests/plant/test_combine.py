"""The virtual combine as a whole against what the paper says of the real one, and against its own promises."""

import copy
import random
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from scipy import signal

from cruise.plant import Combine, Inputs, PlantSettings, Truth
from cruise.plant.sensors import SensorSettings

PERIOD_S = 0.05
LOW_MA, HIGH_MA = 500.0, 1050.0  # around the middle of what moves the machine, 375 to 1150 mA


def with_mass(mass_kg: float) -> PlantSettings:
    return PlantSettings(vehicle=structs.replace(PlantSettings().vehicle, mass_kg=mass_kg))


def drive(combine: Combine, seconds: float, inputs: Callable[[float], Inputs]) -> list[Truth]:
    """Truth every 50 ms from now on."""
    start_s = combine.truth.time_s
    truths = []
    for period in range(1, round(seconds / PERIOD_S) + 1):
        now_s = start_s + period * PERIOD_S
        combine.advance(inputs(now_s), now_s)
        truths.append(combine.truth)
    return truths


def white_noise(combine: Combine, seconds: float, grade_deg: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """White-noise current, 20 Hz and held, and ground speed at the end of each period."""
    noise = random.Random(1)
    currents = [noise.uniform(LOW_MA, HIGH_MA) for _ in range(round(seconds / PERIOD_S))]
    queue = iter(currents)
    truths = drive(combine, seconds, lambda _: Inputs(next(queue), grade_deg=grade_deg))
    return np.array(currents), np.array([truth.ground_speed_mps for truth in truths])


@pytest.fixture(scope="module")
def noise_record() -> tuple[np.ndarray, np.ndarray]:
    current_ma, speed_mps = white_noise(Combine(PlantSettings(), seed=1), 200.0)
    return current_ma[100:], speed_mps[100:]


def test_cross_correlation_peaks_where_the_papers_does(noise_record: tuple[np.ndarray, np.ndarray]) -> None:
    current_ma, speed_mps = (column - column.mean() for column in noise_record)
    # Entry k is the speed at the end of period k, as a sampler would take it together with the current of k + 1.
    lags = range(1, 40)
    correlation = [np.dot(current_ma[: -lag or None], speed_mps[lag - 1 : -1]) for lag in lags]
    peak_s = lags[int(np.argmax(correlation))] * PERIOD_S
    assert peak_s == pytest.approx(0.75, abs=0.051)


def test_frequency_response_is_flat_cut_off_at_1_hz_with_a_bump(noise_record: tuple[np.ndarray, np.ndarray]) -> None:
    current_ma, speed_mps = (column - column.mean() for column in noise_record)
    frequency_hz, power = signal.welch(current_ma, 20.0, nperseg=300)
    _, cross = signal.csd(current_ma, speed_mps, 20.0, nperseg=300)
    gain = np.abs(cross / power)

    def decibel(low_hz: float, high_hz: float) -> float:
        band = (frequency_hz >= low_hz) & (frequency_hz <= high_hz)
        static = (frequency_hz > 0.05) & (frequency_hz < 0.3)
        return 20.0 * np.log10(gain[band].mean() / gain[static].mean())

    assert decibel(0.85, 1.15) == pytest.approx(-3.0, abs=1.0)
    falling_on = 2.0 * decibel(0.85, 1.15) - decibel(0.5, 0.6)
    assert decibel(1.4, 1.6) > falling_on + 0.5, "the response stops falling between 1 and 2 Hz"
    assert abs(decibel(1.4, 1.6) - decibel(0.85, 1.15)) < 1.0
    assert decibel(2.4, 2.6) < -10.0


TABLE_6 = [  # slope_deg, mass_kg, percent of flat and 15700 kg (the paper, table VI)
    (-2.0, 15700.0, 100.6),
    (-3.5, 17200.0, 104.6),
    (-2.0, 18800.0, 105.0),
    (0.0, 17200.0, 97.4),
    (0.0, 18800.0, 97.2),
    (3.3, 15700.0, 90.0),
    (4.4, 17200.0, 87.5),
    (2.8, 18800.0, 90.5),
]


def test_slope_and_mass_act_as_in_table_6() -> None:
    def mean_mps(grade_deg: float, mass_kg: float) -> float:
        return white_noise(Combine(with_mass(mass_kg), seed=1), 30.0, grade_deg=grade_deg)[1][60:].mean()

    flat_mps = mean_mps(0.0, 15700.0)
    percent = {row[:2]: 100.0 * mean_mps(*row[:2]) / flat_mps for row in TABLE_6}
    assert percent == pytest.approx({row[:2]: row[2] for row in TABLE_6}, abs=5.0)
    assert percent[4.4, 17200.0] < percent[3.3, 15700.0] < 95.0
    assert percent[0.0, 18800.0] < percent[0.0, 17200.0] < 100.0


@pytest.fixture(scope="module")
def ramp() -> tuple[list[Truth], list[Truth]]:
    """Slow rise of the current to 1250 mA and back, 10 mA/s."""
    combine = Combine(PlantSettings(), seed=1)
    rise = drive(combine, 125.0, lambda now_s: Inputs(10.0 * now_s))
    fall = drive(combine, 125.0, lambda now_s: Inputs(1250.0 - 10.0 * (now_s - 125.0)))
    return rise, fall


def speed_at(truths: list[Truth], current_ma: float) -> float:
    return min(truths, key=lambda truth: abs(truth.pump_current_ma - current_ma)).ground_speed_mps


def test_ramp_has_dead_zones_and_a_quadratic_middle(ramp: tuple[list[Truth], list[Truth]]) -> None:
    rise, _ = ramp
    assert speed_at(rise, 380.0) < 0.01
    assert speed_at(rise, 480.0) > 0.01
    assert speed_at(rise, 1245.0) - speed_at(rise, 1200.0) < 0.005
    currents_ma = np.arange(450.0, 1050.0, 25.0)
    speeds_mps = np.array([speed_at(rise, current_ma) for current_ma in currents_ma])
    line, parabola = (np.polyfit(currents_ma, speeds_mps, degree) for degree in (1, 2))
    off_line, off_parabola = (np.std(speeds_mps - np.polyval(fit, currents_ma)) for fit in (line, parabola))
    assert parabola[0] > 0.0
    assert off_parabola < 0.35 * off_line


def test_ramp_back_runs_above_the_ramp_up(ramp: tuple[list[Truth], list[Truth]]) -> None:
    rise, fall = ramp
    for current_ma in (600.0, 800.0, 1000.0):
        loop_mps = speed_at(fall, current_ma) - speed_at(rise, current_ma)
        slope = (speed_at(rise, current_ma + 50.0) - speed_at(rise, current_ma - 50.0)) / 100.0
        lag_ma = 2.0 * 10.0 * 0.8  # the ramp goes on during the response time of about 0.8 s, both ways
        assert loop_mps / slope == pytest.approx(2.0 * 18.0 + lag_ma, abs=10.0)


@pytest.fixture(scope="module")
def full_steps() -> dict[int, list[Truth]]:
    return {
        gear: drive(Combine(PlantSettings(), seed=1), 25.0, lambda _, g=gear: Inputs(1250.0, gear=g))
        for gear in (1, 2, 3, 4)
    }


@pytest.mark.parametrize(("gear", "greatest_mps"), [(1, 1.4), (2, 2.5), (3, 4.4), (4, 7.8)])
def test_greatest_speed_of_each_gear(full_steps: dict[int, list[Truth]], gear: int, greatest_mps: float) -> None:
    assert full_steps[gear][-1].ground_speed_mps == pytest.approx(greatest_mps, rel=0.04)


def test_first_and_second_gear_take_the_same_time_the_others_longer(full_steps: dict[int, list[Truth]]) -> None:
    def rise_s(gear: int) -> float:
        truths = full_steps[gear]
        return next(t.time_s for t in truths if t.ground_speed_mps > 0.95 * truths[-1].ground_speed_mps)

    assert rise_s(1) == pytest.approx(rise_s(2), abs=0.3)
    assert rise_s(3) > rise_s(2) + 0.5
    assert rise_s(4) > rise_s(3) + 2.0


def test_speed_is_nearly_proportional_to_engine_speed() -> None:
    def settled_mps(rpm: float) -> float:
        return drive(Combine(PlantSettings(), seed=1), 12.0, lambda _: Inputs(900.0, rpm))[-1].ground_speed_mps

    full_mps = settled_mps(2100.0)
    for rpm in (1300.0, 1700.0):
        assert settled_mps(rpm) / full_mps == pytest.approx(rpm / 2100.0, rel=0.03)


def test_reverse_mirrors_forward() -> None:
    forward, backward = (
        drive(Combine(PlantSettings(), seed=1), 5.0, lambda _, u=current_ma: Inputs(u))[-1]
        for current_ma in (850.0, -850.0)
    )
    assert backward.ground_speed_mps == pytest.approx(-forward.ground_speed_mps, rel=1e-6)
    assert backward.line_pressure_bar == pytest.approx(-forward.line_pressure_bar, rel=1e-6)


@pytest.mark.parametrize("gear", [1, 2, 3, 4])
def test_neutral_current_ends_in_standstill_without_creep(gear: int) -> None:
    combine = Combine(PlantSettings(), seed=1)
    drive(combine, 6.0, lambda _: Inputs(900.0, gear=gear))
    assert combine.truth.ground_speed_mps > 0.5
    still = drive(combine, 15.0, lambda _: Inputs(0.0, gear=gear))[-100:]
    assert {truth.ground_speed_mps for truth in still} == {0.0}
    assert max(abs(truth.acceleration_mps2) for truth in still) == 0.0


def test_hydrostat_brakes_and_neutral_gear_coasts() -> None:
    braked, coasting = Combine(PlantSettings(), seed=1), Combine(PlantSettings(), seed=1)
    for combine in (braked, coasting):
        drive(combine, 15.0, lambda _: Inputs(1200.0, gear=4))
    moving_mps = braked.truth.ground_speed_mps
    fast_rpm = max(truth.engine_speed_rpm for truth in drive(braked, 2.0, lambda _: Inputs(0.0, gear=4)))
    drive(coasting, 2.0, lambda _: Inputs(0.0, gear=0))
    assert fast_rpm > 2130.0, "the wheels drive the engine"
    assert coasting.truth.ground_speed_mps == pytest.approx(moving_mps - 2.0 * 0.33, abs=0.3), (
        "rolling and driveline drag"
    )
    assert braked.truth.ground_speed_mps < coasting.truth.ground_speed_mps - 0.5


def test_brake_holds_the_uncoupled_machine_on_a_hill() -> None:
    combine = Combine(PlantSettings(), seed=1)
    held = drive(combine, 5.0, lambda _: Inputs(0.0, grade_deg=10.0, brake=1.0, clutch=True))[-1]
    assert held.ground_speed_mps == 0.0
    assert drive(combine, 2.0, lambda _: Inputs(0.0, grade_deg=10.0, clutch=True))[-1].ground_speed_mps < -1.0


def test_coupling_keeps_the_momentum() -> None:
    combine = Combine(PlantSettings(), seed=1)
    drive(combine, 10.0, lambda _: Inputs(1200.0, gear=3))
    drive(combine, 0.5, lambda _: Inputs(1200.0, gear=0))
    before = combine.truth
    combine.advance(Inputs(1200.0, gear=2), before.time_s)
    shaft_per_travel = 98.6 / 0.9
    shaft_kg = 0.08 * shaft_per_travel**2
    shaft_mps = before.motor_speed_rpm * np.pi / 30.0 / shaft_per_travel
    expected_mps = (15700.0 * before.ground_speed_mps + shaft_kg * shaft_mps) / (15700.0 + shaft_kg)
    assert combine.truth.ground_speed_mps == pytest.approx(expected_mps, rel=1e-9)


def test_bin_fills_up_to_its_capacity() -> None:
    combine = Combine(PlantSettings(), seed=1)
    assert drive(combine, 20.0, lambda _: Inputs(700.0, grain_flow_kgps=50.0))[-1].machine_mass_kg == pytest.approx(
        16700.0
    )
    assert drive(combine, 20.0, lambda _: Inputs(0.0, grain_flow_kgps=500.0))[-1].machine_mass_kg == 15700.0 + 6700.0


def test_crop_overloads_the_engine() -> None:
    truths = drive(Combine(PlantSettings(), seed=1), 10.0, lambda _: Inputs(900.0, crop_power_kw=260.0))
    assert truths[-1].engine_load_pct == pytest.approx(100.0, abs=1.0)
    assert truths[-1].engine_speed_rpm < 2030.0


def test_half_an_hour_at_constant_current_stays_finite_and_warms_up() -> None:
    quiet = structs.replace(PlantSettings().sensors, pitch_deg=SensorSettings(rate_hz=1.0))
    combine = Combine(structs.replace(PlantSettings(), step_s=0.02, sensors=quiet), seed=1)
    combine.advance(Inputs(900.0), 20.0)
    early_mps = combine.truth.ground_speed_mps
    combine.advance(Inputs(900.0), 1800.0)
    assert combine.truth.ground_speed_mps == pytest.approx(early_mps, rel=0.01)
    assert combine.truth.oil_temperature_c == pytest.approx(52.0, abs=2.5), (
        "losses of 5.1 kW through 190 W/K above 25 degC"
    )


def test_half_the_step_gives_the_same_drive() -> None:
    """The tolerance is that of the default step: 3 mm/s rms and 15 mm/s at most under white noise at 20 Hz."""
    coarse, fine = (
        white_noise(Combine(structs.replace(PlantSettings(), step_s=step_s), seed=1), 25.0)[1]
        for step_s in (0.01, 0.005)
    )
    assert np.sqrt(np.mean((coarse - fine) ** 2)) < 0.003
    assert np.abs(coarse - fine).max() < 0.015


def test_cuts_of_the_calls_change_nothing() -> None:
    whole, cut = Combine(PlantSettings(), seed=4), Combine(PlantSettings(), seed=4)
    readings, pieces = [], []
    chance = random.Random(2)
    for second in range(1, 9):
        inputs = Inputs(400.0 + 80.0 * second, gear=2 + second % 2, grain_flow_kgps=10.0)
        readings += whole.advance(inputs, float(second))
        for _ in range(7):
            pieces += cut.advance(inputs, second - 1 + chance.random())
        pieces += cut.advance(inputs, float(second))
    assert cut.truth == whole.truth
    assert pieces == readings


def test_same_seed_same_readings_other_seed_other_noise() -> None:
    first, again, other = (Combine(PlantSettings(), seed).advance(Inputs(800.0), 3.0) for seed in (7, 7, 8))
    assert first == again
    assert first != other


def test_a_copy_goes_on_as_the_original() -> None:
    combine = Combine(PlantSettings(), seed=3)
    combine.advance(Inputs(800.0), 2.345)
    saved = copy.deepcopy(combine)
    original = combine.advance(Inputs(1000.0, gear=3), 5.0)
    assert saved.advance(Inputs(1000.0, gear=3), 5.0) == original
    assert saved.truth == combine.truth


def test_state_can_be_put_into_another_combine() -> None:
    combine, other = Combine(PlantSettings(), seed=3), Combine(PlantSettings(), seed=99)
    combine.advance(Inputs(800.0), 2.0)
    other.state = copy.deepcopy(combine.state)
    assert other.advance(Inputs(900.0), 4.0) == combine.advance(Inputs(900.0), 4.0)


def test_parameters_change_under_way_and_the_state_stays() -> None:
    combine = Combine(PlantSettings(), seed=1)
    drive(combine, 5.0, lambda _: Inputs(900.0))
    before = combine.truth
    weaker = structs.replace(PlantSettings(), pump=structs.replace(PlantSettings().pump, displacement_cm3=84.0))
    combine.change(weaker)
    assert combine.truth == before
    after = drive(combine, 5.0, lambda _: Inputs(900.0))[-1]
    assert after.ground_speed_mps == pytest.approx(0.8 * before.ground_speed_mps, rel=0.02)
    with pytest.raises(ValueError, match="step_s"):
        combine.change(structs.replace(weaker, step_s=0.005))


def test_an_unknown_gear_is_refused() -> None:
    with pytest.raises(ValueError, match="gear 5"):
        Combine(PlantSettings(), seed=1).advance(Inputs(0.0, gear=5), 0.1)


def test_a_delay_beyond_the_history_is_refused() -> None:
    with pytest.raises(ValueError, match="delay"):
        Combine(PlantSettings(effects=structs.replace(PlantSettings().effects, transport_delay=9.0)), seed=1)


ANY_INPUTS = st.builds(
    Inputs,
    pump_current_ma=st.floats(-1500, 1500),
    engine_speed_setpoint_rpm=st.floats(1300, 2100),
    gear=st.integers(0, 4),
    grade_deg=st.floats(-15, 15),
    rolling_resistance=st.floats(0.0, 0.2),
    crop_power_kw=st.floats(0, 300),
    grain_flow_kgps=st.floats(0, 100),
    brake=st.floats(0, 1),
    clutch=st.booleans(),
)


@settings(max_examples=40)
@given(st.lists(st.tuples(ANY_INPUTS, st.floats(0.05, 2.0)), min_size=1, max_size=8))
def test_any_inputs_give_a_finite_bounded_machine(pieces: list[tuple[Inputs, float]]) -> None:
    combine, now_s = Combine(PlantSettings(), seed=1), 0.0
    for inputs, seconds in pieces:
        now_s += seconds
        readings = combine.advance(inputs, now_s)
        truth = combine.truth
        assert all(np.isfinite(reading.value) for reading in readings)
        assert all(np.isfinite(value) for value in (truth.engine_torque_nm, truth.pump_flow_lpm, truth.pitch_deg))
        # A machine that rolls free downhill gains 2.6 m/s2 at most; what is coupled follows the pump.
        assert abs(truth.ground_speed_mps) < 8.5 + 2.6 * now_s
        assert abs(truth.line_pressure_bar) < 600.0
        assert 0.0 <= truth.engine_speed_rpm < 3500.0
