"""The scene: segments tile what is recorded, hold what they promise, and simulate what the discrete model predicts."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects import Custom, Effect, Stage
from cruise.effects.active_braking import ActiveBraking
from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.crop_load import CropLoad
from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.grade import Grade
from cruise.effects.hysteresis import Hysteresis
from cruise.effects.power_limit import PowerLimit
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.effects.rate_limit import RateLimit
from cruise.effects.saturation import Saturation
from cruise.effects.sensor_bias import SensorBias
from cruise.effects.speed_droop import SpeedDroop
from cruise.effects.wheel_slip import WheelSlip
from cruise.model import prediction
from cruise.model.core import TAIL
from cruise.model.model import Model
from cruise.recording import Recording, resample
from cruise.signals import INPUT, OUTPUT
from cruise.validation import simulation
from cruise.validation.explanation import Explanation
from cruise.validation.simulation import RAN_AWAY_MPS, Scene
from tests.validation.scenes import AHEAD, CORE, EACH, PERIOD_S, recording, scene_of

LONG = 60  # taps that leave nothing out
COMPARED = (AHEAD, AHEAD + 1, AHEAD + 2, 25, 35, AHEAD + EACH - 1)  # samples ahead; all of them take long


def predicted(explanation: Explanation, one: Recording) -> np.ndarray:
    """What the discrete model, with taps that leave nothing out, says of samples that are judged.

    Sample k is predicted from the measured speed at the start of its segment, 15 to 44 samples before.
    """
    blank = explanation.model(one.dt_s)
    like = replace(blank, nb=LONG, theta=(0.0,) * (len(blank.theta) - blank.nb + LONG))
    return by_segments(explanation.model(one.dt_s, like), one)


def by_segments(model: Model, one: Recording) -> np.ndarray:
    result = np.full(len(one), np.nan)
    k = np.arange(AHEAD, len(one))
    steps = AHEAD + (k - AHEAD) % EACH
    for ahead in COMPARED:
        speed = prediction.ahead(model, one.input, one.output, one.columns, ahead)
        result[k[steps == ahead]] = speed[k[steps == ahead]]
    return result


CASES: dict[str, tuple[tuple[Effect, ...], tuple[float, ...]]] = {
    "core alone": ((), ()),
    "command": ((DeadZone(300.0, 20.0),), ()),
    "command with memory": ((RateLimit(300.0, 0.2), Hysteresis(60.0), DeadZone(200.0)), ()),
    "gain": ((EngineSpeed(1.0),), ()),
    "gain with pace": ((GearRatio(1.4, 2.5, 4.4, 7.8),), ()),
    "load": ((Grade(0.5, 0.3, 0.5),), (0.4,)),
    "dynamics with pace": ((DeadZone(250.0), ActiveBraking(0.4)), ()),
    "sensor": ((SensorBias(4.0),), (0.6,)),
    "gain of the speed": ((SpeedDroop(0.08),), ()),
    "gain of the speed with a signal": ((PowerLimit(15.0, 0.3, 0.05),), ()),
    "load of the speed": ((CoulombFriction(0.3),), (0.3,)),
    "load of the speed with a memory": ((CropLoad(8.0, 0.0),), (0.5,)),
    "all at once": (
        (
            Hysteresis(40.0),
            DeadZone(250.0, 10.0),
            EngineSpeed(1.2),
            GearRatio(1.4, 2.5, 3.5, 7.8),
            SpeedDroop(0.05),
            Grade(1.0, 0.2, 0.3),
            CropLoad(5.0, 0.0),
            CoulombFriction(0.2),
            ActiveBraking(1.6),
        ),
        (0.3, 0.4, 0.2),
    ),
}


@pytest.mark.parametrize("stroke_share", [0.0, 0.6])
@pytest.mark.parametrize(("effects", "loads"), CASES.values(), ids=CASES)
def test_a_scene_simulates_what_the_discrete_model_predicts(effects, loads, stroke_share):
    one = recording()
    explanation = Explanation(replace(CORE, stroke_share=stroke_share), effects, loads, 0.1)
    (simulated,) = scene_of(one).simulate([explanation])
    by_model = predicted(explanation, one)
    known = np.isfinite(by_model)
    assert known.sum() >= 4 * len(COMPARED)
    # What a limit had left before a segment began is forgotten within its seconds, but not wholly.
    forgotten = 2e-3 if any(isinstance(one, PowerLimit) for one in effects) else 1e-6
    assert simulated[known] == pytest.approx(by_model[known], abs=forgotten)
    if effects:
        (bare,) = scene_of(one).simulate([Explanation(CORE, (), (), 0.1)])
        assert np.nanmax(np.abs(simulated - bare)) > 0.02


def test_with_the_models_own_taps_they_differ_by_no_more_than_the_tail():
    one = recording()
    effects, loads = CASES["all at once"]
    explanation = Explanation(CORE, effects, loads, 0.1)
    (simulated,) = scene_of(one).simulate([explanation])
    difference = np.abs(simulated - by_segments(explanation.model(PERIOD_S), one))
    assert 1e-6 < np.nanmax(difference) < 2.0 * TAIL * CORE.gain_mps_per_ma * np.ptp(one.input)


def test_a_memory_of_speed_that_starts_unknown_matters_little_three_seconds_later():
    """The model remembers a measured speed before the segment, the scene doesn't: one sample of acceleration."""
    one = recording()
    explanation = Explanation(CORE, (CropLoad(5.0, 10.0),), (0.5,), 0.1)
    (simulated,) = scene_of(one).simulate([explanation])
    a = CORE.pole(PERIOD_S)
    fastest = float(np.max(np.abs(np.diff(one.output)))) / PERIOD_S * float(np.max(np.abs(one.output)))
    bound = (1.0 - a) * a ** (AHEAD - 2) * 0.5 * 0.01 * 10.0 * fastest
    assert bound < 2e-3
    assert np.nanmax(np.abs(simulated - predicted(explanation, one))) < bound


def test_slip_that_starts_unknown_matters_little_three_seconds_later():
    """The model knows the slip before the segment, the scene starts with none: what is left of that decays as a^15."""
    one = recording()
    explanation = Explanation(CORE, (WheelSlip(0.1),), (0.8,), 0.1)
    (simulated,), (bare,) = (scene_of(one).simulate([each]) for each in (explanation, Explanation(CORE, (), (), 0.1)))
    assert CORE.pole(PERIOD_S) ** AHEAD < 0.01
    assert np.nanmax(np.abs(simulated - predicted(explanation, one))) < 0.01 * np.max(np.abs(one.output))
    assert np.nanmax(np.abs(simulated - bare)) > 0.2


@pytest.mark.parametrize("case", ["core alone", "command", "load", "all at once"])
def test_from_a_finer_recording_it_is_the_same_to_a_percent_of_the_speed(case):
    """As late and as steep at 20 Hz as at 5 Hz, but for lags that see the one before as held over a sample."""
    effects, loads = CASES[case]
    explanation = Explanation(CORE, effects, loads, 0.1)
    fine = recording(dt_s=0.05)
    coarse = resample(fine, PERIOD_S)
    (from_fine,) = scene_of(coarse, raw=(fine,)).simulate([explanation])
    (from_coarse,) = scene_of(coarse).simulate([explanation])
    difference = from_fine - from_coarse
    assert np.sqrt(np.nanmean(difference**2)) < 0.025 * np.std(coarse.output)
    assert abs(np.nanmean(difference)) < 0.001 * np.mean(coarse.output)


@pytest.mark.parametrize("dt_s", [0.01, 0.02, 0.04, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("averaged", [False, True])
def test_a_current_that_nothing_reshapes_is_the_one_of_the_grid(dt_s, averaged):
    fine = replace(recording(dt_s=dt_s), averaged=averaged)
    coarse = resample(fine, PERIOD_S) if dt_s < PERIOD_S else fine
    scene = scene_of(coarse, raw=(fine,))
    assert scene.drive(()) == pytest.approx(coarse.input, abs=1e-9)


def test_the_mean_of_a_reshaped_current_is_taken_where_the_current_was_measured():
    dt_s = 0.02
    time_s = dt_s * np.arange(1, 2001)
    u = np.where(np.arange(2000) % 10 < 5, 500.0, 700.0)  # within one period of 0.2 s both
    fine = Recording(time_s, {INPUT: u, OUTPUT: 1.0 + 0.1 * np.sin(time_s)}, dt_s, "fast.csv")
    coarse = resample(fine, PERIOD_S)
    drive_ma = scene_of(coarse, raw=(fine,)).drive((DeadZone(600.0),))
    assert drive_ma[5:] == pytest.approx(np.full(len(coarse) - 5, 50.0), abs=1e-9)
    felt = scene_of(coarse, raw=(fine,)).felt(replace(CORE, delay_s=0.0), (DeadZone(600.0),))
    assert felt[20:] == pytest.approx(np.full(len(coarse) - 20, 50.0), abs=6.0)
    alone = scene_of(coarse).drive((DeadZone(600.0),))
    assert np.max(np.abs(alone)) < 15.0


BEGINS_ANEW = [
    (RateLimit(300.0, 0.2),),
    (RateLimit(lag_s=0.4),),
    (Hysteresis(90.0),),
    (DeadZone(400.0, 30.0, jump_share=0.5, release_share=0.6),),
    (QuadraticGain(-0.4), Saturation(700.0)),
    (Custom("square", Stage.COMMAND, "value + 1e-3 * value * value"), Hysteresis(60.0), RateLimit(400.0)),
]


@pytest.mark.parametrize("effects", BEGINS_ANEW, ids=lambda effects: "+".join(one.name for one in effects))
def test_what_reshapes_the_current_begins_anew_in_each_of_several_recordings(effects):
    """Those of one rate are reshaped as one."""
    several = [
        recording(seconds, seed, dt_s) for seed, (seconds, dt_s) in enumerate([(30.0, 0.2), (9.0, 0.1), (41.0, 0.2)])
    ]
    scene = scene_of(*(resample(one, PERIOD_S) for one in several), raw=tuple(several))
    alone = [scene_of(resample(one, PERIOD_S), raw=(one,)).drive(effects) for one in several]
    np.testing.assert_array_equal(scene.drive(effects), np.concatenate(alone))
    assert np.ptp(scene.drive(effects) - scene.drive(())) > 30.0


@pytest.mark.parametrize("stroke_share", [0.0, 0.6])
def test_side_by_side_is_the_same_as_one_after_the_other(stroke_share):
    scene = scene_of(recording(), recording(30.0, seed=1))
    effects, loads = CASES["all at once"]
    batch = []
    for i in range(4):
        mine = tuple(
            effect.reshaped(
                **{
                    name: value + 0.05 * i * (bound.high - value)
                    for name, bound in effect.parameters.items()
                    for value in [getattr(effect, name)]
                }
            )
            for effect in effects
        )
        core = replace(CORE, delay_s=0.3 + 0.07 * i, time_constant_s=0.5 + 0.1 * i, stroke_share=stroke_share)
        batch.append(Explanation(core, mine, tuple(load * (1.0 + 0.2 * i) for load in loads), 0.1 * i))
    together = scene.simulate(batch)
    alone = np.array([scene_of(*scene.recordings).simulate([one])[0] for one in batch])
    np.testing.assert_allclose(together, alone, rtol=0.0, atol=1e-12)
    assert np.nanmin(np.nanmax(np.abs(np.diff(together, axis=0)), axis=1)) > 0.01
    np.testing.assert_array_equal(scene.simulate(batch[::-1])[::-1], together)
    np.testing.assert_allclose(scene.errors(batch), scene.speed_mps - together)


def test_what_is_kept_has_a_size_and_what_is_forgotten_is_made_again(monkeypatch):
    one = scene_of(recording())
    batch = [Explanation(replace(CORE, lag_s=lag_s)) for lag_s in (0.1, 0.2, 0.3, 0.4, 0.5)]
    whole = [one.simulate([each]) for each in batch]
    monkeypatch.setattr(simulation, "CACHED_BYTES", 3 * one.current_ma.nbytes)
    small = scene_of(recording())
    for each, before in zip([*batch, *batch], [*whole, *whole], strict=True):
        np.testing.assert_array_equal(small.simulate([each]), before)
        assert small._cached_bytes == sum(map(simulation._bytes, small._cache.values()))
        assert small._cached_bytes <= simulation.CACHED_BYTES


@pytest.mark.parametrize("seconds", [(40.0,), (40.0, 9.2, 3.2, 3.0, 61.4), (2.0, 2.8)])
@pytest.mark.parametrize("horizon_s", [3.0, 1.0, 5.0])
def test_every_sample_that_can_be_is_judged_once_and_far_enough_ahead(seconds, horizon_s):
    recordings = [
        recording(40.0 if span < 5 else span, seed)[: round(span / PERIOD_S)] for seed, span in enumerate(seconds)
    ]
    scene = scene_of(*recordings, horizon_s=horizon_s)
    ahead = round(horizon_s / PERIOD_S)
    times = np.zeros(len(scene), int)
    for segment in range(scene.steps.shape[1]):
        samples = scene.steps[:, segment][scene.shown[:, segment]]
        np.add.at(times, samples, 1)
        start = scene.steps[0, segment] - 1
        (part,) = [part for part in scene.parts if part.start <= start < part.stop]
        assert np.all((samples - start >= ahead) & (samples < part.stop))
        assert np.all(samples - start < ahead + EACH)
        assert scene.start_mps[segment] == scene.speed_mps[start]
    expected = np.zeros(len(scene), int)
    for part in scene.parts:
        expected[part.start + ahead : part.stop] = 1
    np.testing.assert_array_equal(times, expected)
    np.testing.assert_array_equal(scene.judged, expected == 1)
    (speed,) = scene.simulate([Explanation(CORE, (), (), 0.1)])
    np.testing.assert_array_equal(np.isfinite(speed), scene.judged)


def test_a_slope_does_not_act_on_a_machine_that_stands_at_no_current():
    """Held by its brakes on a slope: the grade that pulls it as soon as it moves says nothing there."""
    samples = 400
    time_s = PERIOD_S * np.arange(samples)
    stands = (time_s > 30.0) & (time_s < 55.0)
    one = Recording(
        time_s,
        {
            INPUT: np.where(stands, 0.0, 800.0),
            OUTPUT: np.where(stands, 0.01, 1.5),
            "pitch_deg": np.full(samples, 5.0),
        },
        PERIOD_S,
        "hill.csv",
    )
    uphill = Explanation(CORE, (Grade(),), (0.5,), 0.0)
    (speed,), (level,) = (scene_of(one).simulate([explanation]) for explanation in (uphill, Explanation(CORE)))
    held, moves = (time_s > 40.0) & (time_s < 54.0), (time_s > 70.0) & np.isfinite(speed)
    assert np.abs(speed[held]).max() < 0.01
    pull_mps = 0.5 * 9.81 * np.sin(np.radians(5.0))
    np.testing.assert_allclose(level[moves] - speed[moves], pull_mps, atol=0.02)
    crept = Recording(one.time_s, {**one.columns, OUTPUT: np.where(stands, -0.4, 1.5)}, PERIOD_S, "rolls.csv")
    (rolled,) = scene_of(crept).simulate([uphill])
    assert rolled[held].max() < -0.9 * pull_mps, "one that rolls back is not held"


def test_a_machine_that_rolls_on_steeper_ground_is_not_held_where_it_passes_rest_either():
    time_s = PERIOD_S * np.arange(900)
    idle = time_s % 60.0 > 30.0
    steep = time_s > 120.0
    columns = {INPUT: np.where(idle, 0.0, 800.0), "pitch_deg": np.where(steep, 6.0, 0.5)}
    stands = Recording(time_s, {**columns, OUTPUT: np.where(idle, 0.0, 1.5)}, PERIOD_S, "held.csv")
    assert scene_of(stands).held.sum() == idle.sum()
    moves_mps = np.where(idle, np.where(steep, -0.4, -0.03), 1.5)
    rolls = Recording(time_s, {**columns, OUTPUT: moves_mps}, PERIOD_S, "rolls.csv")
    assert not scene_of(rolls).held.any()
    short = Recording(time_s, {**stands.columns, INPUT: np.where(time_s % 60.0 > 58.0, 0.0, 800.0)}, PERIOD_S, "s.csv")
    assert not scene_of(short).held.any(), "never left alone: nobody knows"


@pytest.mark.parametrize("core", [CORE, replace(CORE, servo_hz=1.0, resonance_share=0.3)])
def test_recordings_are_never_joined(core):
    """Each of them simulated alone says the same, with every memory begun anew, whatever is filtered beside it."""
    recordings = recording(), recording(6.0, seed=2), recording(30.0, seed=1)
    explanation = Explanation(core, *CASES["all at once"], 0.1)
    (together,) = scene_of(*recordings).simulate([explanation])
    for part, one in zip(np.split(together, [200, 230]), recordings, strict=True):
        alone = Scene([one], sorted(one.columns))
        np.testing.assert_allclose(part, alone.simulate([explanation])[0], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("dt_s", [0.05, 0.07, 0.12, 0.15, 0.18])
def test_a_mean_is_over_its_period_at_any_rate_of_the_recording(dt_s):
    fine = recording(40.0, dt_s=dt_s)
    coarse = resample(fine, PERIOD_S)
    each_ms = np.repeat(fine.input, round(1000.0 * dt_s))  # from the first sample's time on
    ends = np.round(1000.0 * (coarse.time_s - fine.since_s[0])).astype(int)
    inside = (ends >= 200) & (ends <= len(each_ms))
    exact = np.array([each_ms[end - 200 : end].mean() for end in ends[inside]])
    means = scene_of(coarse, raw=(fine,)).drive(())
    np.testing.assert_allclose(means[inside], exact, rtol=0.0, atol=1e-6)


def test_too_short_a_recording_is_not_judged():
    one = recording()[: AHEAD - 1]
    scene = scene_of(one)
    assert not scene.judged.any()
    assert np.isnan(scene.errors([Explanation(CORE, (), (), 0.1)])).all()


@pytest.mark.parametrize("effect", [SpeedDroop(0.5), SpeedDroop(0.4, 2.2)])
def test_a_run_that_goes_away_errs_by_a_great_number_without_a_warning(effect):
    scene = scene_of(recording(60.0))
    (errors,) = scene.errors([Explanation(replace(CORE, gain_mps_per_ma=1e200), (effect,), (), 0.1)])
    assert np.isfinite(errors[scene.judged]).all()
    assert np.max(np.abs(errors[scene.judged])) > 0.9 * RAN_AWAY_MPS
