"""A study lays recordings out and fits the model to them, or says in words what is in the way."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.identification.regressors import FitError
from cruise.identification.structures import parse
from cruise.model.model import Model
from cruise.recording import Recording
from cruise.report.diagnosis import of_the_core
from cruise.signals import INPUT, OUTPUT
from cruise.validation.candidates import DelayCandidate, EffectCandidate, ResonanceCandidate
from cruise.validation.diagnose import Verdict, diagnose
from cruise.validation.search import Search
from cruise.validation.study import candidate, discrete, study
from tests.validation.driving import (
    DELAY_S,
    GAIN,
    GRAVITY_MPS2,
    LAG_S,
    OFFSET_MPS,
    SECOND_LAG_S,
    VEHICLE_S,
    drive,
    lagged,
    wander,
)

PERIOD_S = 0.2
PLAIN = parse("arx:na=1,nb=3,delay_s=0.4")


def changed(one: Recording, **columns: np.ndarray) -> Recording:
    return Recording(one.time_s, {**one.columns, **columns}, one.dt_s, one.source)


@pytest.mark.parametrize(("asked_s", "judged_s", "samples"), [(3.0, 3.0, 15), (2.5, 2.4, 12), (0.05, 0.2, 1)])
def test_the_horizon_is_that_of_whole_periods(asked_s, judged_s, samples):
    found = study([drive(120.0)], PLAIN, None, PERIOD_S, asked_s)
    assert (found.horizon_s, found.horizon) == (judged_s, samples)


# -- what is in the way


def test_too_short_a_recording_is_refused():
    with pytest.raises(
        FitError, match=r"^37 s of the recordings can be judged, too little: record 60 s or more, in st"
    ):
        study([drive(40.0)], PLAIN, None, PERIOD_S)
    with pytest.raises(FitError, match=r"in stretches of at least 11 s without a hole; a qu"):
        study([drive(40.0)], PLAIN, None, PERIOD_S, 5.0)
    study([drive(40.0), drive(40.0, 1)], PLAIN, None, PERIOD_S)


def test_a_quick_drive_that_is_judged_less_far_ahead_needs_less():
    with pytest.raises(FitError, match=r"record 12 s or more, in stretches of at least 1\.8 s without a hole"):
        study([drive(11.0)], PLAIN, None, 0.1, 0.6)
    quick = study([drive(40.0, dt_s=0.05, vehicle_s=0.1)], PLAIN, None, 0.1, 0.6)
    assert len(np.unique(quick.search.blocks)) == 10
    assert quick.base.loss**0.5 < 1.3 * 0.02


@pytest.mark.parametrize("dt_s", [0.1, 0.2])
def test_a_current_that_never_changes_is_refused(dt_s):
    one = drive(100.0, dt_s=dt_s)
    still = changed(one, **{INPUT: np.full(len(one), 640.0)})
    with pytest.raises(
        FitError, match=r"^the current never changes, there is nothing to learn from: drive the machine"
    ):
        study([still], PLAIN, None, PERIOD_S)


def test_a_speed_that_never_changes_is_refused():
    one = drive(100.0)
    with pytest.raises(FitError, match=r"^the speed is 1\.2 m/s throughout, there is nothing to identify"):
        study([changed(one, **{OUTPUT: np.full(len(one), 1.2)})], PLAIN, None, PERIOD_S)


def test_samples_that_are_longer_than_a_drive_takes_to_answer_are_refused():
    with pytest.raises(FitError, match=r"^samples of 10 s are longer than a drive takes to answer.*of 1 s or less$"):
        study([drive(900.0)], PLAIN, None, 10.0)


def test_a_narx_model_is_refused():
    with pytest.raises(FitError, match=r"^a NARX model has polynomials in place of effects: diagnose an arx, armax or"):
        study([drive(100.0)], parse("narx1"), None, PERIOD_S)


def test_a_recording_that_is_too_slow_is_refused():
    with pytest.raises(FitError, match=r"drive\.csv is sampled every 0\.5 s, too slowly for a model of 0\.2 s"):
        study([drive(100.0, dt_s=0.5)], PLAIN, None, PERIOD_S)


def test_an_effect_of_the_model_whose_signal_is_missing_is_refused():
    needing = parse("arx:na=1,nb=3,delay_s=0.4+engine_speed")
    with pytest.raises(
        FitError,
        match=r"^the model's engine_speed can't be computed: engine_speed_rpm is not recorded; record it, or leave",
    ):
        study([drive(100.0)], needing, None, PERIOD_S)
    with_it = drive(100.0, columns={"engine_speed_rpm": np.full(1000, 2050.0)})
    with pytest.raises(FitError, match="engine_speed_rpm is not recorded"):
        study([with_it, drive(100.0, 1)], needing, None, PERIOD_S)
    started = drive(100.0, columns={"engine_speed_rpm": np.where(np.arange(1000) == 3, 900.0, 2050.0)})
    for one in (with_it, started):  # it hardly moves: the model may have it all the same
        assert study([one], needing, None, PERIOD_S).base.explanation.names == ("engine_speed",)


# -- what is fitted


@pytest.fixture(scope="module")
def plain():
    return study([drive(200.0, 5, 0.1, 0.02)], PLAIN, None, PERIOD_S)


def test_the_machines_numbers_are_found(plain):
    core = plain.base.explanation.core
    assert core.gain_mps_per_ma == pytest.approx(GAIN, rel=0.01)
    assert core.time_constant_s == pytest.approx(VEHICLE_S, rel=0.06)
    assert plain.base.explanation.offset_mps == pytest.approx(OFFSET_MPS, abs=0.02)
    true_s = DELAY_S + LAG_S + SECOND_LAG_S
    found_s = core.delay_s + core.lag_s + core.second_lag_s
    assert found_s == pytest.approx(true_s, abs=0.03)
    assert np.sqrt(plain.base.loss) == pytest.approx(0.02 / np.sqrt(2.0), rel=0.2)
    assert plain.period_s == PERIOD_S


@pytest.mark.parametrize("vehicle_s", [20.0, 60.0])
def test_a_vehicle_that_is_pushed_takes_as_long_as_it_does(vehicle_s):
    """A torque moves a car for a minute before its drag equals it: that is no effect, but the core."""
    pushed = {"gain": vehicle_s / VEHICLE_S / 5.0, "load_mps": -vehicle_s / VEHICLE_S / 5.0 * 575.0 * GAIN}
    one = study([drive(300.0, vehicle_s=vehicle_s, **pushed)], PLAIN, None, PERIOD_S)
    assert one.base.explanation.core.time_constant_s == pytest.approx(vehicle_s, rel=0.25)
    assert one.base.loss**0.5 < 1.3 * 0.02


def test_the_delay_is_no_longer_than_the_structure_can_represent():
    one = drive(120.0, 5)
    short = study([one], parse("arx:na=1,nb=1,delay_s=0"), None, PERIOD_S)
    assert short.search.longest_delay_s == pytest.approx(0.1)
    assert short.base.explanation.core.delay_s <= 0.1
    assert study([one], parse("arx:na=1,nb=3,delay_s=0.4"), None, PERIOD_S).search.longest_delay_s == pytest.approx(0.6)
    assert study([one], parse("arx:na=1,nb=40,delay_s=1"), None, PERIOD_S).search.longest_delay_s == 2.0


def test_the_models_effects_are_fitted_with_the_core():
    one = drive(160.0, 5, 0.1, 0.02, command=lambda u: np.maximum(u - 350.0, 0.0))
    heard = []
    begun = study([one], parse("arx:na=1,nb=3,delay_s=0.4+dead_zone"), None, PERIOD_S, show=heard.append)
    (effect,) = begun.base.explanation.effects
    assert isinstance(effect, DeadZone)
    assert effect.threshold_ma == pytest.approx(350.0, abs=8.0)
    assert heard == ["fitting the core", "fitting with dead_zone", "fitting all together"]
    bare = study([one], PLAIN, None, PERIOD_S)
    assert begun.base.loss < 0.6 * bare.base.loss


def test_the_effects_of_a_file_start_where_they_were():
    one = drive(160.0, 5, 0.1, 0.02, command=lambda u: np.maximum(u - 350.0, 0.0))
    structure = parse("arx:na=1,nb=3,delay_s=0.4+dead_zone")
    file = Model(PERIOD_S, 1, 3, 2, (DeadZone(330.0),), (0.7, 3e-4, 2e-4, 2e-4, 0.05))
    begun = study([one], structure, file, PERIOD_S)
    (effect,) = begun.base.explanation.effects
    assert isinstance(effect, DeadZone)
    assert effect.threshold_ma == pytest.approx(350.0, abs=8.0)
    assert effect.edge_ma == pytest.approx(0.0, abs=8.0)


def test_what_recordings_say_nothing_about_is_not_fitted():
    gear = np.where(np.arange(1000) < 500, 2.0, 3.0)
    begun = study([drive(100.0, columns={"gear": gear})], PLAIN, None, PERIOD_S)
    assert begun.search.fixed >= {"gear_ratio.gear_1_mps", "gear_ratio.gear_2_mps", "gear_ratio.gear_4_mps"}
    assert not {"gear_ratio.gear_3_mps", "gear_ratio.pace_exponent"} & begun.search.fixed
    slow = study([drive(100.0, columns={"gear": np.minimum(gear, 2.0)})], PLAIN, None, PERIOD_S)
    assert "gear_ratio.pace_exponent" in slow.search.fixed
    assert {"grade.acceleration_share", "power_limit.load_share"} <= begun.search.fixed
    loaded = study([drive(100.0, columns={"engine_load_pct": 50.0 + gear})], PLAIN, None, PERIOD_S)
    assert "power_limit.load_share" not in loaded.search.fixed


def test_a_servo_of_second_order_is_the_cores_and_no_effect():
    one = study([drive(400.0, noise_mps=0.01, pair=(0.9, 0.7))], PLAIN, None, PERIOD_S)
    assert one.base.explanation.core.servo_hz == pytest.approx(0.9, rel=0.15), "it trades with the lags"
    assert one.base.explanation.core.servo_damping == pytest.approx(0.7, abs=0.08)
    assert one.base.explanation.names == ()
    assert np.sqrt(one.base.loss) < 0.0085, "the noise of means over two samples is 0.0071"
    assert diagnose(one).verdict is Verdict.NOTHING


@pytest.mark.parametrize(
    ("pair", "its_own"),
    [
        ((0.6, 0.4), False),
        ((1.2, 0.4), False),
        ((0.5, 0.65), True),
        ((0.7, 0.55), True),
        ((1.6, 0.55), True),
        ((0.6, 0.85), True),
    ],
)
def test_a_pair_that_rings_is_a_resonance_and_no_servo(pair, its_own):
    one = study([drive(300.0, 1, 0.1, 0.005, pair=pair)], parse("arx:na=1,nb=3,delay_s=0.5"), None, 0.2)
    assert bool(one.base.explanation.core.servo_hz) == its_own


def test_a_servo_that_two_lags_describe_has_no_pair(plain):
    assert plain.base.explanation.core.servo_hz == 0.0


def test_no_pair_stands_in_for_dead_time_that_the_model_lacks():
    late = drive(400.0, noise_mps=0.01)
    late = changed(late, **{INPUT: np.concatenate([late.input[9:], np.full(9, late.input[-1])])})
    one = study([late], parse("arx:na=1,nb=2,delay_s=0.2"), None, PERIOD_S)
    assert one.base.explanation.core.servo_hz == 0.0
    assert diagnose(one).effects == ("transport_delay",)


def test_the_pair_is_found_where_an_effect_hid_that_it_is_there(monkeypatch):
    slope = wander(4000, 0.1, 3, 3.0, 8.0)
    load = -0.15 * np.sin(np.radians(slope)) * GRAVITY_MPS2
    driven = drive(400.0, noise_mps=0.01, load_mps=load, columns={"pitch_deg": slope}, pair=(0.9, 0.7))
    monkeypatch.setattr("cruise.validation.search.SERVO_GAIN", 0.1)
    one = study([driven], PLAIN, None, PERIOD_S)
    assert one.base.explanation.core.servo_hz == 0.0, "a tenth of what the slope leaves"
    found = diagnose(one)
    assert found.effects == ("grade",)
    assert found.final.explanation.core.servo_hz == pytest.approx(0.9, rel=0.15), "it trades with the lags"


def yielding_drive(share: float = 0.6) -> Recording:
    """A drive whose time constant rises with its stroke, T (1 - s + s w / 1.5 m/s), by a recursion of its own."""
    plain = drive(300.0, noise_mps=0.0)
    felt = GAIN * lagged(np.repeat(plain.input, 10), 0.2)
    speed, found = 0.0, []
    for drive_mps in felt.tolist():
        speed += (1.0 - np.exp(-0.01 / (0.6 * (1.0 - share + share * drive_mps / 1.5)))) * (drive_mps - speed)
        found.append(speed)
    noise = 0.005 * np.random.default_rng(1).standard_normal(len(plain))
    return changed(plain, **{OUTPUT: np.array(found)[9::10] + noise})


def test_what_a_file_knows_of_how_the_drive_yields_is_fitted_on(monkeypatch):
    driven = yielding_drive()
    file = Model(PERIOD_S, 1, 3, 1, (), (0.7, 1e-4, 3e-4, 3e-4, 0.0), stroke_share=0.3)
    knowing = study([driven], PLAIN, file, PERIOD_S)
    assert knowing.base.explanation.core.stroke_share == pytest.approx(0.6, abs=0.08)
    assert discrete(knowing, knowing.base).stroke_share == knowing.base.explanation.core.stroke_share
    monkeypatch.setattr(Search, "yielding", lambda self, present, least: present)
    assert knowing.base.loss < 0.5 * study([driven], PLAIN, replace(file, stroke_share=0.0), PERIOD_S).base.loss


def test_a_drive_that_yields_by_its_stroke_is_the_cores_and_no_effect(plain):
    one = study([yielding_drive()], PLAIN, None, PERIOD_S)
    assert one.base.explanation.core.stroke_share == pytest.approx(0.6, abs=0.08)
    found = diagnose(one)
    assert found.verdict is Verdict.NOTHING
    (said,) = of_the_core(found)
    assert re.match(r"the drive gives way to forces by its stroke, (5[2-9]|6[0-8]) % of how far it does at 1\.5", said)
    assert plain.base.explanation.core.stroke_share == 0.0


def test_columns_that_not_all_recordings_have_are_left_out():
    both, one = drive(60.0, columns={"header": wander(600, 0.1, 1, 1.0, 4.0)}), drive(60.0, 1)
    begun = study([both, one], PLAIN, None, PERIOD_S)
    assert "header" not in begun.search.scene.signals
    assert "header" in study([both, both], PLAIN, None, PERIOD_S).search.scene.signals


def test_a_candidate_by_name(plain):
    assert candidate("transport_delay", plain.recordings) == DelayCandidate()
    assert candidate("resonance", plain.recordings) == ResonanceCandidate()
    assert candidate("hysteresis", plain.recordings) == EffectCandidate("hysteresis")
    with pytest.raises(
        FitError, match=r"^grade can't be added: pitch_deg is not recorded; record a drive in which it is"
    ):
        candidate("grade", plain.recordings)


# -- the model that drives


def test_the_discrete_model_carries_the_standard_errors_over(plain):
    model = discrete(plain, plain.base)
    assert replace(model, theta_std=(), residual_std_mps=0.02) == plain.base.explanation.model(PERIOD_S)
    slots = [slot.name for slot in plain.base.fit.layout.slots]
    covariance = plain.search.covariance(plain.base.fit)
    core, offset = plain.base.explanation.core, plain.base.explanation.offset_mps
    a, t_v = core.pole(PERIOD_S), core.time_constant_s
    lag, rest = slots.index("time_constant_s"), slots.index("offset_mps")
    slope = a * PERIOD_S / t_v**2  # of a by T_v
    assert model.theta_std[0] == pytest.approx(slope * np.sqrt(covariance[lag, lag]), rel=1e-3)
    gradient = np.array([-slope * offset, 1.0 - a])
    part = covariance[np.ix_([lag, rest], [lag, rest])]
    assert model.theta_std[-1] == pytest.approx(np.sqrt(gradient @ part @ gradient), rel=1e-3)
    assert len(model.theta_std) == len(model.theta)
    assert all(std > 0.0 for std in model.theta_std)
    one_step = plain.search.scene.speed_mps - plain.search.ahead_mps(plain.base.explanation, 1)
    assert model.residual_std_mps == pytest.approx(np.sqrt(np.nanmean(one_step**2)))
    assert 0.01 < model.residual_std_mps < 0.04


def test_an_engine_speed_of_the_file_keeps_its_exponent():
    """The shape of a given effect is fitted, from where it was."""
    rpm = 2050.0 + wander(1600, 0.1, 9, 120.0, 4.0)
    one = drive(160.0, 5, 0.1, 0.02, gain=rpm / 2100.0, columns={"engine_speed_rpm": rpm})
    file = Model(PERIOD_S, 1, 3, 2, (EngineSpeed(0.8),), (0.7, 3e-4, 2e-4, 2e-4, 0.05))
    begun = study([one], parse("arx:na=1,nb=3,delay_s=0.4+engine_speed"), file, PERIOD_S)
    (effect,) = begun.base.explanation.effects
    assert isinstance(effect, EngineSpeed)
    assert effect.exponent == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("measured_s", "computed_s"), [(0.01, 0.04), (0.02, 0.04), (0.05, 0.05), (0.2, 0.2)])
def test_the_current_is_reshaped_at_the_rate_of_the_recording_but_no_finer_than_a_servo_moves(measured_s, computed_s):
    one = study([drive(160.0, dt_s=measured_s)], parse("arx:na=1,nb=3,delay_s=0.4"), None, 0.2)
    (raw,) = one.search.scene.raw
    assert raw.dt_s == pytest.approx(computed_s)
