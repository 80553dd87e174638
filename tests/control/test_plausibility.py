"""What the signals say about each other: every check finds its lie, in time, and none finds one in the truth."""

import math
from collections.abc import Callable
from dataclasses import replace
from random import Random

import pytest

from cruise.control.plausibility import CHECKS, Plausibility, PlausibilitySettings, Seen

FRAME_S = 0.05
TRUE = Seen(
    time_s=0.0,
    speed_mps=1.5,
    wheel_mps=1.55,
    radar_mps=1.5,
    current_ma=800.0,
    commanded_ma=800.0,
    followed_mps=1.5,
    disturbance_mps=0.1,
    expected_mps=-0.01,
    unexpected_mps=0.01,
    coming_mps=(-0.01,) * 8,
    quicker=1.0,
    alpha=1.0,
    crowding=1.0,
    faulty_share=0.0,
    repeated=0,
    imposters=0,
    wavering=0,
    upset=False,
    slowness=1.0,
)
NOISE = {"ground_speed_mps": 0.015, "pump_current_ma": 1.0, "engine_speed_rpm": 2.0}
Lie = Callable[[Seen, float], Seen]
"""What is seen, and for how long the lie has been there in s, to what is seen with the lie in it."""
Course = Callable[[float], float]
"""Engine speed in 1/min by time in s."""


def found(
    lie: Lie, seconds: float = 3.0, noise: dict[str, float] = NOISE, settings: PlausibilitySettings | None = None
) -> tuple[str, float]:
    """The first contradiction and when it was found; three seconds of truth before."""
    plausibility, dice = Plausibility(settings or PlausibilitySettings(), FRAME_S), Random(1)
    for k in range(1, round((3.0 + seconds) / FRAME_S) + 1):
        now_s = k * FRAME_S
        lying = now_s > 3.0
        for i in (1, 0):
            for name, value in (("ground_speed_mps", 1.5), ("pump_current_ma", 800.0), ("engine_speed_rpm", 2100.0)):
                std = noise[name] if lying else NOISE[name]
                plausibility.read(name, now_s - 0.02 * i, value + dice.gauss(0.0, std))
        seen = replace(TRUE, time_s=now_s)
        said = plausibility.step(lie(seen, now_s - 3.0) if lying else seen)
        if said:
            assert lying, f"{said}, though nobody lied"
            return said, now_s - 3.0
    return "", math.nan


def swinging(time_s: float) -> float:
    """A command that stays near 800 mA: what comes late is not off by much."""
    return 800.0 + 20.0 * math.sin(2.0 * time_s)


def moving(seen: Seen, own_mps2: float, more_mps2: float, time_s: float) -> Seen:
    """A speed that the drive changes at one rate and something else at another, from now on and for a second."""
    within_s = min(time_s, 1.0)
    speed_mps = seen.speed_mps + (own_mps2 + more_mps2) * within_s
    frame_s = FRAME_S if time_s <= 1.0 else 0.0
    return replace(
        seen,
        speed_mps=speed_mps,
        wheel_mps=speed_mps + 0.05,
        radar_mps=speed_mps,
        followed_mps=speed_mps,
        expected_mps=seen.expected_mps + own_mps2 * frame_s,
        unexpected_mps=seen.unexpected_mps + more_mps2 * frame_s,
    )


LIES: dict[str, tuple[Lie, float]] = {
    "another node sends our messages": (lambda seen, s: replace(seen, imposters=1), 0.0),
    "two setpoints take turns": (lambda seen, s: replace(seen, wavering=3), 0.0),
    "the program's memory changed by itself": (lambda seen, s: replace(seen, upset=True), 0.0),
    "frames of a message come damaged or out of order": (lambda seen, s: replace(seen, faulty_share=0.6), 0.0),
    "the drive's frames were heard before": (lambda seen, s: replace(seen, repeated=25), 0.0),
    "a message has a second sender": (lambda seen, s: replace(seen, crowding=1.7), 0.0),
    "the program gets too little time": (lambda seen, s: replace(seen, slowness=1.6), 0.0),
    "the current does not follow its command": (
        lambda seen, s: replace(seen, commanded_ma=800.0 + 100.0 * s, current_ma=845.0 + 100.0 * s),
        0.1,
    ),
    "the current has left its command": (lambda seen, s: replace(seen, current_ma=820.0), 0.05),
    "the current is late behind its command": (
        lambda seen, s: replace(seen, commanded_ma=swinging(s), current_ma=swinging(s - 0.35)),
        1.5,
    ),
    "the drive's speed has left that of wheel and ground": (lambda seen, s: replace(seen, speed_mps=1.36), 0.7),
    "the drive's speed is not that of wheel and ground": (
        lambda seen, s: replace(seen, speed_mps=1.5 - 0.4 * min(s, 1.0)),
        1.3,
    ),
    "the speed changes faster than tyres allow": (
        lambda seen, s: replace(seen, speed_mps=1.5 + 5.0 * s, wheel_mps=1.5 + 5.0 * s, radar_mps=1.5 + 5.0 * s),
        0.3,
    ),
    "current and speed do not fit the model": (lambda seen, s: replace(seen, disturbance_mps=-0.9), 0.3),
    "the speed changes as no command did": (lambda seen, s: replace(seen, unexpected_mps=-0.08), 0.15),
    "a force came at once, as no hill does": (lambda seen, s: moving(seen, 0.0, -0.5, s), 0.4),
    "the machine does not follow": (lambda seen, s: replace(seen, followed_mps=2.0), 1.5),
}


@pytest.mark.parametrize("check", LIES)
def test_a_check_finds_its_lie_in_time(check):
    lie, within_s = LIES[check]
    said, after_s = found(lie)
    assert said == check
    assert after_s <= within_s + 1.01 * FRAME_S


def test_a_machine_that_is_behind_for_a_moment_follows_all_the_same():
    """As in fourth gear, where the ground rises just as it has slowed down."""
    said, _ = found(lambda seen, s: replace(seen, followed_mps=2.0) if s < 1.4 else seen)
    assert not said


def test_a_drive_that_shows_too_little_does_not_pass_for_one_whose_wheels_slip():
    settings = PlausibilitySettings(speed_change_mps=0.24)  # a habit is not what tells here
    said, _ = found(lambda seen, s: replace(seen, speed_mps=1.5 - 0.25 * min(s, 1.0)), settings=settings)
    assert said == "the drive's speed is not that of wheel and ground"


def test_a_speed_that_jumps_within_two_frames_is_found_at_once():
    """All sensors alike, 0.16 m/s: less than 0.2 s allow."""
    said, after_s = found(lambda seen, s: replace(seen, unexpected_mps=0.08 if s < 0.11 else 0.01))
    assert said == "the speed changes as no command did"
    assert after_s == pytest.approx(2 * FRAME_S)


@pytest.mark.parametrize("more_mps2", [0.5, -0.5])
def test_a_force_is_found_though_the_drive_moves(more_mps2):
    """Evenly, at 0.5 m/s2: a model that errs by half of that errs by the same all the time."""
    plausibility, said, k = Plausibility(PlausibilitySettings(), FRAME_S), "", 0
    while not said and k < 60:
        k += 1
        now_s, unexpected_mps2 = k * FRAME_S, 0.25 + (more_mps2 if k > 40 else 0.0)
        speed_mps = 1.0 + 0.5 * now_s + more_mps2 * max(now_s - 2.0, 0.0)
        said = plausibility.step(
            replace(
                TRUE,
                time_s=now_s,
                speed_mps=speed_mps,
                wheel_mps=speed_mps + 0.05,
                radar_mps=speed_mps,
                followed_mps=speed_mps,
                expected_mps=0.25 * FRAME_S,
                unexpected_mps=unexpected_mps2 * FRAME_S,
                coming_mps=(0.25 * FRAME_S,) * 8,
            )
        )
    assert said == "a force came at once, as no hill does"
    assert 44 < k <= 48


@pytest.mark.parametrize("name", NOISE)
def test_a_noisy_sensor_is_found_and_a_frozen_one(name):
    assert found(lambda seen, s: seen, noise=NOISE | {name: 20.0 * NOISE[name]})[0] == "a sensor is too noisy"
    said, after_s = found(lambda seen, s: seen, noise=NOISE | {name: 0.0})
    assert said == "a sensor is frozen"
    assert after_s == pytest.approx(0.55, abs=0.06)


JUMPED, TOO_FAST = "the engine speed has jumped and not come back", "the engine speed changes faster than it can"
GAPS_S = (0.01, 0.02, 0.05, 0.2)  # s between two readings of the engine speed, 100 to 5 Hz


def engine(rpm_by_s: Course, until_s: float, gap_s: Course = lambda s: FRAME_S) -> list[tuple[float, str]]:
    """What is said by time of an engine speed that is this, read that often, while a person drives."""
    plausibility, said, read_s = Plausibility(PlausibilitySettings(), FRAME_S), [], 0.0
    for k in range(1, round(until_s / FRAME_S) + 1):
        now_s = round(k * FRAME_S, 6)
        while (next_s := round(read_s + gap_s(read_s), 6)) <= now_s:
            read_s = next_s
            plausibility.read("engine_speed_rpm", read_s, rpm_by_s(read_s))
        seen = replace(TRUE, time_s=now_s, commanded_ma=math.nan, followed_mps=math.nan)
        said.append((now_s, plausibility.step(seen)))
    return said


def jumps(rpm_by_s: Course, at_s: tuple[float, ...]) -> list[str]:
    """What is said at these times, in s."""
    return [said for now_s, said in engine(rpm_by_s, max(at_s)) if any(abs(now_s - one_s) < 1e-6 for one_s in at_s)]


def test_an_engine_speed_that_jumped_is_not_believed_until_it_is_back_or_the_engine_stands():
    lies = [JUMPED, JUMPED]
    assert jumps(lambda s: 1450.0 + 2.0 * s if s > 2.0 else 2100.0, (1.0, 3.0, 30.0)) == ["", *lies]
    assert jumps(lambda s: 1450.0 if 2.0 < s < 8.0 else 2050.0, (3.0, 7.0, 11.0)) == [*lies, ""]
    assert jumps(lambda s: 1450.0 if 2.0 < s < 8.0 else 2050.0 - 1200.0 * max(s - 10.0, 0.0), (3.0, 7.0, 12.5)) == [
        *lies,
        "",
    ]
    assert jumps(lambda s: math.nan if 2.0 < s < 2.4 else 1450.0 if s > 2.0 else 2100.0, (2.2, 3.0)) == ["", JUMPED]
    assert jumps(lambda s: 1450.0 if s > 2.0 and not 6.0 < s < 7.0 else 2100.0 * (s < 6.0), (3.0, 11.0)) == [JUMPED, ""]


def test_an_engine_that_starts_and_a_throttle_that_is_turned_have_not_jumped():
    assert jumps(lambda s: min(2500.0 * max(s - 1.0, 0.0), 900.0), (1.6, 5.0)) == ["", ""]
    assert jumps(lambda s: 2100.0 - 700.0 * min(max(s - 1.0, 0.0), 1.0), (1.3, 1.6, 5.0)) == ["", "", ""]


@pytest.mark.parametrize("rpm_per_s", [400.0, -400.0, 1200.0, -1200.0])
@pytest.mark.parametrize("gap_s", GAPS_S)
def test_an_engine_speed_that_a_throttle_moves_may_be_read_at_any_rate(gap_s, rpm_per_s):
    course = engine(lambda s: 1500.0 + rpm_per_s * min(max(s - 1.0, 0.0), 0.4), 4.0, lambda s: gap_s)
    assert not {JUMPED, TOO_FAST} & {said for _, said in course}


@pytest.mark.parametrize("gap_s", GAPS_S)
def test_an_engine_speed_that_changes_too_fast_is_found_at_any_rate(gap_s):
    course = engine(lambda s: 1000.0 + 2000.0 * min(max(s - 1.0, 0.0), 0.6), 4.0, lambda s: gap_s)
    assert min(now_s for now_s, said in course if said) <= 1.0 + max(0.2, gap_s) + 2.0 * FRAME_S


def test_readings_that_are_lost_or_held_up_while_a_throttle_moves_are_no_jump():
    def throttle(s: float) -> float:
        return 2100.0 - 400.0 * min(max(s - 1.0, 0.0), 1.0)

    lost = engine(throttle, 4.0, lambda s: 0.24 if s == 1.5 else 0.02)
    assert {said for _, said in lost} == {""}
    plausibility = Plausibility(PlausibilitySettings(), FRAME_S)
    for k in range(1, 80):
        for i in (1, 0):
            read_s = k * FRAME_S - 0.02 * i
            arrived_s = max(read_s, 1.74) if read_s > 1.5 else read_s  # those of 0.24 s come at once
            plausibility.read("engine_speed_rpm", arrived_s, throttle(read_s))
        assert plausibility.step(replace(TRUE, time_s=k * FRAME_S, commanded_ma=math.nan)) == ""


def test_a_fall_of_200_between_two_readings_is_found_at_once():
    assert jumps(lambda s: 1900.0 if s > 2.0 else 2100.0, (2.0, 2.05, 2.1)) == ["", "", TOO_FAST]


def test_every_check_is_tried_above():
    assert {check.name for check in CHECKS} == {
        *LIES,
        "a sensor is too noisy",
        "a sensor is frozen",
        JUMPED,
        TOO_FAST,
    }


def quick(times: float, quicker: float, more_mps2: float = 0.0) -> str:
    """What is said of a drive that answers a command so many times as quickly as its model, and of another force.

    The command takes 1 m/s from the speed, by the model with a lag of 1.2 s.
    """
    plausibility, speed_mps, said = Plausibility(PlausibilitySettings(), FRAME_S), 3.0, []

    def lagging_mps(time_s: float, lag_s: float) -> float:
        return 3.0 - (1.0 - math.exp(-max(time_s - 3.0, 0.0) / lag_s))

    for k in range(1, 120):
        now_s = k * FRAME_S
        steps = [lagging_mps(now_s + i * FRAME_S, 1.2) - lagging_mps(now_s + (i - 1) * FRAME_S, 1.2) for i in range(11)]
        true_mps = lagging_mps(now_s, 1.2 / times) - lagging_mps(now_s - FRAME_S, 1.2 / times)
        true_mps += more_mps2 * FRAME_S if now_s > 3.0 else 0.0
        speed_mps += true_mps
        same = dict.fromkeys(("speed_mps", "radar_mps", "followed_mps"), speed_mps)
        seen = replace(TRUE, time_s=now_s, wheel_mps=speed_mps + 0.05, **same, quicker=quicker)
        moved = {"expected_mps": steps[0], "unexpected_mps": true_mps - steps[0], "coming_mps": tuple(steps[1:])}
        said.append(plausibility.step(replace(seen, **moved)))
    return next(filter(None, said), "")


def test_a_fast_gear_may_answer_three_times_as_quickly_as_its_model_but_not_the_other_way():
    force = "a force came at once, as no hill does"
    assert quick(3.0, 1.0) == force
    assert quick(3.0, 2.7) == ""
    assert quick(0.8, 2.7) == ""
    assert quick(1.0, 2.7, more_mps2=1.2) == force


def swing_mps(time_s: float) -> float:
    """Up and down again, at 0.8 m/s2."""
    return 0.4 * min(max(2.0 * time_s, 0.0), 1.0, max(2.0 - 2.0 * (time_s - 1.0), 0.0) / 2.0)


HARMLESS: dict[str, Lie] = {
    "the truth": lambda seen, s: seen,
    "the command moves at its greatest rate and the current a frame later": lambda seen, s: replace(
        seen, commanded_ma=800.0 + 600.0 * min(s, 0.5), current_ma=800.0 + 600.0 * min(max(s - FRAME_S, 0.0), 0.5)
    ),
    "an output stage that gives 3 % more, as always, at another current": lambda seen, s: replace(
        seen, commanded_ma=800.0 - min(200.0 * s, 300.0), current_ma=800.0 - 1.03 * min(200.0 * s, 300.0)
    ),
    "the current comes a time-out late": lambda seen, s: replace(
        seen, commanded_ma=swinging(s), current_ma=swinging(s - 0.25)
    ),
    "the current is not what was commanded, and in time": lambda seen, s: replace(
        seen, commanded_ma=swinging(s), current_ma=80.0 + 0.9 * swinging(s - 0.1)
    ),
    "two quick changes of the speed, and wheel and radar come later": lambda seen, s: replace(
        seen,
        speed_mps=1.5 + swing_mps(s),
        wheel_mps=1.55 + swing_mps(s - 0.15),
        radar_mps=1.5 + swing_mps(s - 0.15),
        followed_mps=1.3,
    ),
    "wheels slip uphill": lambda seen, s: replace(seen, wheel_mps=1.8, radar_mps=1.5),
    "wheels slip, and there is no radar": lambda seen, s: replace(seen, wheel_mps=1.83, radar_mps=math.nan),
    "no other speed is there": lambda seen, s: replace(
        seen, speed_mps=1.5 - 0.2 * min(s, 1.0), wheel_mps=math.nan, radar_mps=math.nan
    ),
    "the radar alone is wrong": lambda seen, s: replace(seen, radar_mps=0.0),
    "the wheel alone is wrong": lambda seen, s: replace(seen, wheel_mps=0.0),
    "the operator changes his mind and back": lambda seen, s: replace(seen, wavering=2),
    "a burst of frames": lambda seen, s: replace(seen, crowding=1.5),
    "a hill takes more of the speed in a fast gear": lambda seen, s: replace(seen, disturbance_mps=-1.0, alpha=0.33),
    "the speed is noisy": lambda seen, s: replace(seen, unexpected_mps=0.05 * math.cos(20.0 * math.pi * s)),
    "the model errs by half while the drive begins to move": lambda seen, s: moving(seen, 0.8, 0.4, s),
    "a hill of 8 degrees comes within 2.5 s, and nothing meets it": lambda seen, s: replace(
        seen, unexpected_mps=0.01 - FRAME_S * 0.55 * min(s, 2.0)
    ),
    "behind for a moment": lambda seen, s: replace(seen, followed_mps=2.5 if s < 0.9 else 1.5),
    "nothing is measured": lambda seen, s: replace(
        seen, speed_mps=math.nan, current_ma=math.nan, disturbance_mps=math.nan
    ),
    "somebody else drives, at another current": lambda seen, s: replace(
        seen, commanded_ma=math.nan, followed_mps=math.nan, current_ma=500.0, crowding=3.0
    ),
}


@pytest.mark.parametrize("case", HARMLESS)
def test_what_may_be_is_no_contradiction(case):
    assert found(HARMLESS[case]) == ("", pytest.approx(math.nan, nan_ok=True))


def test_the_contradiction_goes_with_its_cause():
    plausibility = Plausibility(PlausibilitySettings(), FRAME_S)
    assert plausibility.step(replace(TRUE, time_s=1.0, imposters=0, faulty_share=0.9))
    assert plausibility.step(replace(TRUE, time_s=1.05)) == plausibility.contradiction == ""


EXPERIMENT = replace(TRUE, commanded_ma=math.nan, followed_mps=math.nan, experimenting=True)


@pytest.mark.parametrize("check", LIES)
def test_in_an_experiment_those_checks_are_asked_that_steps_and_noise_pass(check):
    lie, within_s = LIES[check]
    plausibility, held = Plausibility(PlausibilitySettings(), FRAME_S), next(c for c in CHECKS if c.name == check)
    said = []
    for k in range(1, 120):
        now_s = k * FRAME_S
        seen = replace(EXPERIMENT, time_s=now_s)
        lying = replace(lie(seen, now_s - 3.0), commanded_ma=math.nan, followed_mps=math.nan)
        plausibility.step(lying if now_s > 3.0 else seen)
        said.append((now_s, plausibility.in_experiment))
    assert (check in [one for now_s, one in said if now_s <= 3.0 + within_s + 1.01 * FRAME_S]) is held.experiment
    assert not any(one for now_s, one in said if now_s <= 3.0)


@pytest.mark.parametrize(("value", "found"), [(0.04, "a sensor is frozen"), (0.0, "")])
def test_a_sensor_that_freezes_in_an_experiment_is_found_unless_it_counts_nothing_as_at_standstill(value, found):
    for experimenting, said in ((True, found), (False, "")):
        plausibility = Plausibility(PlausibilitySettings(), FRAME_S)
        for k in range(1, 60):
            plausibility.read("ground_speed_mps", k * FRAME_S, value)
            plausibility.step(replace(EXPERIMENT, time_s=k * FRAME_S, experimenting=experimenting))
        assert plausibility.in_experiment == said


def test_a_threshold_that_switches_its_check_off_is_refused():
    PlausibilitySettings(jump_mps=0.89)
    with pytest.raises(ValueError, match=r"jump_mps is 0.91, more than 3 times the default of 0.3"):
        PlausibilitySettings(jump_mps=0.91)


def regulated(errors_ma, driving=lambda k: True):
    """The first contradiction, and its frame, of an output stage whose error is this in each frame."""
    plausibility = Plausibility(PlausibilitySettings(), FRAME_S)
    for k, error_ma in enumerate(errors_ma):
        commanded_ma = 800.0 if driving(k) else math.nan
        seen = replace(TRUE, time_s=k * FRAME_S, commanded_ma=commanded_ma, current_ma=800.0 + error_ma)
        if said := plausibility.step(seen):
            return said, k
    return "", -1


def test_an_error_of_the_output_stage_that_was_always_there_is_its_own():
    assert regulated([30.0] * 100) == ("", -1)


def test_an_error_that_grows_as_the_output_stage_becomes_warm_is_its_own_too():
    assert regulated([0.075 * k for k in range(400)]) == ("", -1)  # 30 mA within 20 s


def test_what_was_its_own_error_is_known_in_the_next_drive_too():
    errors = [0.0] * 60 + [30.0] * 40
    assert regulated(errors, lambda k: k < 40 or k >= 80) == ("the current has left its command", 85)
