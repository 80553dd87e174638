"""An experiment frame by frame: its current within limits of its own, its end, and what is refused beforehand."""

import math
from contextlib import nullcontext
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise import settings as strict
from cruise.control.commissioning import (
    Commissioning,
    CommissioningLimits,
    CommissioningSettings,
    Experiment,
    Experiments,
    Progress,
    check,
)
from cruise.control.controller import ControlSettings
from cruise.control.excitation import Multisine, Ramp, Steps, WhiteNoise
from cruise.settings import SettingsError

CONFIG = Path(__file__).parents[2] / "config"
FRAME_S = 0.05
SETTINGS = CommissioningSettings(experiments="experiments.yaml")
NOISE = Experiment(
    name="noise",
    number=3,
    excitation=WhiteNoise(low_ma=450.0, high_ma=1050.0, seconds=20.0),
    speed_max_mps=3.0,
    lead_s=2.0,
    settle_s=1.0,
)


def run(experiment: Experiment, limits: CommissioningLimits = SETTINGS.limits, jitter_s: float = 0.0):
    """Every frame of an experiment: currents and progress. It begins at 100 s, ticks come up to `jitter_s` late."""
    late = np.random.default_rng(5).uniform(0.0, jitter_s, 100_000)
    commissioning = Commissioning(limits, FRAME_S)
    currents, progress, k = [], [], 0
    commissioning.begin(experiment, 100.0 + late[0])
    while not commissioning.over(now_s := 100.0 + k * FRAME_S + late[k]):
        currents.append(commissioning.step(now_s))
        progress.append(commissioning.progress)
        k += 1
    commissioning.end(100.0 + k * FRAME_S)
    return np.array(currents), progress, commissioning


def test_white_noise_passes_the_limits_unchanged():
    currents, progress, commissioning = run(NOISE)
    current = NOISE.current()
    np.testing.assert_array_equal(currents, [current.current_ma(k * FRAME_S) for k in range(len(currents))])
    assert len(currents) == round(NOISE.duration_s / FRAME_S) == 500
    assert [progress.count(phase) for phase in (1, 2, 3)] == [60, 400, 40]
    assert commissioning.progress is Progress.FINISHED
    assert np.abs(np.diff(currents)).max() > ControlSettings().limits.rate_max_ma_per_s * FRAME_S  # of the controller


@pytest.mark.parametrize("jitter_s", [0.001, 0.02])
def test_ticks_that_come_late_neither_repeat_nor_leave_out_a_value(jitter_s):
    np.testing.assert_array_equal(run(NOISE, jitter_s=jitter_s)[0], run(NOISE)[0])


@given(st.floats(0.0, 600.0), st.floats(650.0, 1200.0), st.floats(10.0, 20000.0))
def test_whatever_is_excited_what_leaves_is_within_the_limits(low_ma, high_ma, rate_ma_per_s):
    limits = CommissioningLimits(current_min_ma=low_ma, current_max_ma=high_ma, rate_max_ma_per_s=rate_ma_per_s)
    commissioning = Commissioning(limits, FRAME_S)
    commissioning.begin(NOISE, 0.0)
    sent = [commissioning.step(k * FRAME_S) for k in range(120)]
    assert all(low_ma <= current <= high_ma for current in sent)
    reach_ma = rate_ma_per_s * FRAME_S
    assert np.abs(np.diff(sent)).max() <= reach_ma + 1e-9


def test_the_end_is_neutral_at_once_and_says_that_it_was_early():
    commissioning = Commissioning(SETTINGS.limits, FRAME_S)
    commissioning.begin(NOISE, 0.0)
    for k in range(200):
        commissioning.step(k * FRAME_S)
    assert commissioning.limits.last_ma > 400.0
    assert commissioning.left_s(10.0) == pytest.approx(15.0)
    commissioning.end(10.0)
    assert commissioning.limits.last_ma == 0.0
    assert (commissioning.progress, commissioning.left_s(10.0), commissioning.over(1e6)) == (
        Progress.ENDED_EARLY,
        0.0,
        False,
    )
    commissioning.end(20.0)  # once ended it stays as it was
    assert commissioning.progress is Progress.ENDED_EARLY


def changed(**fields) -> Experiment:
    return msgspec.structs.replace(NOISE, **fields)


@pytest.mark.parametrize(
    ("experiment", "settings", "complaint"),
    [
        (changed(), {"limits": CommissioningLimits(current_max_ma=1000.0)}, "450 to 1050 mA is not within"),
        (changed(), {"limits": CommissioningLimits(current_min_ma=500.0)}, "450 to 1050 mA is not within"),
        (changed(), {"limits": CommissioningLimits(rate_max_ma_per_s=600.0)}, "changes by 600 mA a frame"),
        (changed(speed_max_mps=9.0), {}, "speed_max_mps 9 is above that of commissioning, 8.5"),
        (changed(settle_s=2000.0), {}, "takes 2024 s, commissioning.duration_max_s is 1200"),
        (
            changed(excitation=msgspec.structs.replace(NOISE.excitation, hold_s=0.07)),
            {},
            "no multiple of control.frame_s",
        ),
        (
            changed(excitation=Ramp(low_ma=0.0, high_ma=900.0, rate_ma_per_s=700.0)),
            {"limits": CommissioningLimits(rate_max_ma_per_s=600.0)},
            "changes by 35 mA a frame",
        ),
        (
            changed(
                excitation=Multisine(
                    mean_ma=700.0, peak_ma=300.0, low_hz=0.1, high_hz=3.0, period_s=10.0, periods=2, phases="random"
                )
            ),
            {"limits": CommissioningLimits(rate_max_ma_per_s=2000.0)},
            "commissioning.limits let 100 mA pass",
        ),
    ],
)
def test_what_would_not_come_out_as_it_is_written_is_refused(experiment, settings, complaint):
    with pytest.raises(SettingsError, match=r"experiments\.yaml: noise: ") as caught:
        check([experiment], msgspec.structs.replace(SETTINGS, **settings), FRAME_S)
    assert complaint in str(caught.value)
    check([NOISE], SETTINGS, FRAME_S)


def sines(high_hz: float) -> Multisine:
    return Multisine(mean_ma=750.0, peak_ma=200.0, low_hz=0.1, high_hz=high_hz, period_s=10.0, periods=2)


def steps(hold_min_s: float, hold_max_s: float) -> Steps:
    return Steps(seconds=20.0, hold_min_s=hold_min_s, hold_max_s=hold_max_s, levels_ma=(500.0, 900.0))


@pytest.mark.parametrize(
    ("excitation", "frame_s", "complaint"),
    [
        (steps(0.05, 0.05), 0.1, "a hold time of 0.05 s is no multiple of control.frame_s, 0.1"),
        (steps(0.1, 0.2), 0.1, "a hold time of 0.15 s is no multiple of control.frame_s, 0.1"),
        (steps(1.0, 1.0), 0.03, "a hold time of 1 s is no multiple of control.frame_s, 0.03"),
        (sines(2.6), 0.1, "high_hz 2.6 is more than frames of control.frame_s, 0.1 s, can show: 2.5 Hz"),
    ],
)
def test_what_the_frames_cannot_give_is_refused(excitation, frame_s, complaint):
    with pytest.raises(SettingsError) as caught:
        check([changed(excitation=excitation)], SETTINGS, frame_s)
    assert complaint in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("excitation", "frame_s"),
    [
        (steps(8.0, 8.0), 0.1),
        (steps(3.0, 8.0), 0.05),
        (steps(0.05, 0.1), 0.01),
        (steps(8.0, 8.0), 0.02),
        (sines(2.5), 0.1),
        (sines(5.0), 0.05),
    ],
)
def test_what_the_frames_can_give_comes_out_as_it_is_written(excitation, frame_s):
    experiment, limits = changed(excitation=excitation), CommissioningLimits(rate_max_ma_per_s=1e5)
    check([experiment], msgspec.structs.replace(SETTINGS, limits=limits), frame_s)
    commissioning, current = Commissioning(limits, frame_s), experiment.current()
    commissioning.begin(experiment, 0.0)
    sent = [commissioning.step(k * frame_s) for k in range(round(experiment.duration_s / frame_s))]
    for t_s in np.arange(0.005, experiment.duration_s, 0.01):
        if isinstance(excitation, Steps) and current.begin_s < t_s < current.end_s:
            assert sent[int(t_s / frame_s + 1e-6)] == current.current_ma(t_s)


def test_the_change_a_frame_is_that_of_its_own_length():
    ramp = changed(excitation=Ramp(low_ma=0.0, high_ma=900.0, rate_ma_per_s=700.0))
    for frame_s in (0.02, 0.05, 0.1):
        for rate_ma_per_s, refused in ((690.0, True), (710.0, False)):
            limited = msgspec.structs.replace(SETTINGS, limits=CommissioningLimits(rate_max_ma_per_s=rate_ma_per_s))
            with pytest.raises(SettingsError, match="mA a frame") if refused else nullcontext():
                check([ramp], limited, frame_s)


def test_limits_that_are_set_in_part_keep_the_rate_of_commissioning():
    read = strict.parse("experiments: e.yaml\nlimits: {current_max_ma: 1100.0}", CommissioningSettings, "cruise.yaml")
    assert read.limits.rate_max_ma_per_s == SETTINGS.limits.rate_max_ma_per_s > 10_000.0
    with pytest.raises(SettingsError, match="current_min_ma has to be at least 0"):
        strict.parse("experiments: e.yaml\nlimits: {current_min_ma: -5.0}", CommissioningSettings, "cruise.yaml")


def test_the_experiments_of_the_paper_are_there_and_pass():
    experiments = strict.load(CONFIG / "experiments.yaml", Experiments).experiments
    check(experiments, SETTINGS, ControlSettings().frame_s)
    kinds = {type(experiment.excitation).__name__ for experiment in experiments}
    assert kinds == {"WhiteNoise", "Steps", "Ramp", "Multisine"}
    assert {experiment.conditions.gear for experiment in experiments} == {1, 2, 3, 4}
    draws = {experiment.current().form(0.0) for experiment in experiments if kinds and experiment.number < 10}
    assert len(draws) == 4  # what judges must not be what taught


@pytest.mark.parametrize(("first", "second"), [(("a", 1), ("b", 1)), (("a", 1), ("a", 2))])
def test_names_and_numbers_are_unique(first, second):
    with pytest.raises(ValueError, match="share name or number"):
        Experiments(experiments=tuple(changed(name=name, number=number) for name, number in (first, second)))


def test_equal_seeds_are_equal_and_others_are_not():
    def drawn(**fields) -> list[float]:
        current = changed(**fields).current()
        return [current.current_ma(3.0 + k * FRAME_S) for k in range(50)]

    assert drawn() == drawn()
    assert drawn() != drawn(seed=1)
    assert drawn() != drawn(number=4)
    assert not any(math.isnan(value) for value in drawn())
