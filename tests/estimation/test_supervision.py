"""The running 3 s ahead errors are those of a free run; only a model that proves itself takes over, and goes again."""

import math
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

from cruise.control.controller import ControlSettings
from cruise.control.proof import Proof, ProofSettings
from cruise.estimation.shadow import Horizon, Shadow
from cruise.estimation.supervision import Change, SupervisionSettings, Supervisor
from cruise.model.prediction import ahead
from cruise.signals import Sample
from tests.estimation.conftest import TRUE, Machine, columns, steps

SETTINGS = SupervisionSettings()
PROOF = Proof(ControlSettings(), ProofSettings())
HORIZON = 15  # 3 s of 0.2 s


def judge(step, model, samples):
    """Hand every sample to `step` with the model's state before its speed; returns what `step` returned."""
    state = model.start(samples[0].speed_mps, samples[0].current_ma, samples[0].signals)
    returned = []
    for sample in samples:
        state = model.apply(state, sample.current_ma, sample.signals)
        returned.append(step(state, sample))
        state = model.observe(state, sample.speed_mps)
    return returned


def supervised(supervisor, samples, learned):
    """What was decided; `learned` is a model, or what gives the one of each sample."""
    model = supervisor.driving
    given = learned if callable(learned) else lambda k: learned
    numbers = iter(range(len(samples)))
    found = judge(lambda state, sample: supervisor.step(state, sample, partial(given, next(numbers))), model, samples)
    return [one for one in found if one is not None]


def strong(model, factor):
    a, b, loads, c_0 = model.split(model.theta)
    return model.with_theta((*a, *(factor * value for value in b), *loads, factor * c_0))


@pytest.mark.parametrize("gear", [2.0, 4.0])
def test_without_disturbance_the_error_is_that_of_a_free_run(factory, machine, gear):
    shadow, samples = Shadow(factory, Horizon(HORIZON, 1.0, 0.0)), machine.drive(steps(20, 1), 1)
    samples = [replace(one, signals={**one.signals, "gear": gear}) for one in samples]
    squares = []

    def step(state, sample):
        shadow.step((state, sample), counts=True)
        squares.append(shadow.mean_square)

    judge(step, factory, samples)
    currents, speeds, signals = columns(samples)
    expected = (speeds - ahead(factory, currents, speeds, signals, HORIZON)) ** 2
    np.testing.assert_allclose(squares[HORIZON + 6 :], expected[HORIZON + 6 :], rtol=1e-9)
    assert math.isnan(squares[HORIZON - 1])
    assert shadow.proof == pytest.approx(np.nansum(squares))


def test_a_model_that_takes_a_place_in_the_shadow_is_judged_as_if_it_had_always_been_there(factory, machine):
    samples, horizon = machine.drive(steps(30, 2), 2), Horizon(HORIZON, 1.0, 0.0)
    one, past = Shadow(factory.with_theta(TRUE), horizon), []
    other = Shadow(factory, horizon)

    def step(state, sample):
        nonlocal other
        past.append((state, sample))
        if len(past) == 100:
            other = Shadow(factory.with_theta(TRUE), horizon, past[-HORIZON - 1 : -1], other)
        for shadow in (one, other):
            shadow.step((state, sample), counts=False)
        return other.rms_mps == pytest.approx(one.rms_mps, rel=1e-9)

    same = judge(step, factory, samples)
    assert not any(same[HORIZON + 1 : 99])
    assert all(same[99:])


def test_persistence_is_the_speed_three_seconds_ago(factory, machine):
    supervisor, samples = Supervisor(factory, SETTINGS, PROOF), machine.drive(steps(20, 2), 2)
    supervised(supervisor, samples[:HORIZON], factory)
    assert supervisor.rms_mps == {}
    supervised(supervisor := Supervisor(factory, SETTINGS, PROOF), samples[: HORIZON + 1], factory)
    expected = abs(samples[HORIZON].speed_mps - samples[0].speed_mps)
    assert supervisor.rms_mps["persistence"] == pytest.approx(expected)


def test_a_disturbance_that_was_known_three_seconds_ago_is_no_error(factory, machine):
    samples = machine.drive(steps(60, 3), 3, disturbance_mps=-0.05)
    true = factory.with_theta(TRUE)
    knows, blind = Shadow(true, Horizon(HORIZON, 0.04, 0.1)), Shadow(true, Horizon(HORIZON, 0.04, 0.0))
    judge(lambda state, sample: [one.step((state, sample), False) for one in (knows, blind)], true, samples)
    assert knows.rms_mps < 0.03
    assert blind.rms_mps > 0.15


def test_a_better_model_takes_over_after_its_proof_and_a_worse_one_never(factory, machine):
    samples = machine.drive(steps(90, 4), 4)
    better, worse = factory.with_theta(TRUE), factory.with_theta((0.9, 6e-4, 6e-4, 6e-4, 0.1))
    supervisor = Supervisor(factory, SETTINGS, PROOF)
    (adopted,) = supervised(supervisor, samples, better)
    assert adopted.change is Change.ADOPTED
    assert supervisor.driving is better
    assert supervisor.adoptions == 1
    assert adopted.time_s >= SETTINGS.horizon_s + SETTINGS.proof_s
    assert adopted.figures["learned_mps"] < adopted.figures["driving_mps"] == adopted.figures["factory_mps"]
    assert adopted.figures["gain_margin"] > 1.8
    assert "it proved itself" in str(adopted)
    supervisor = Supervisor(factory, SETTINGS, PROOF)
    (refused,) = supervised(supervisor, samples, worse)  # the same reason again and again
    assert refused.change is Change.REFUSED
    assert "error is above" in refused.why
    assert supervisor.driving is factory


def test_a_candidate_is_judged_on_what_came_after_it(factory, machine):
    """It learns by heart: what it would say of the past is right, and it is another one at every sample."""
    samples, given = machine.drive(steps(60, 5), 5), []

    def learned(k):
        given.append(factory.with_theta((*TRUE[:-1], TRUE[-1] + 1e-6 * k)))
        return given[-1]

    supervisor = Supervisor(factory, SETTINGS, PROOF)
    adopted = supervised(supervisor, samples, learned)[0]
    since = given.index(supervisor.driving) if supervisor.adoptions == 1 else None
    assert since is not None
    assert adopted.time_s - samples[since].time_s >= SETTINGS.horizon_s + SETTINGS.proof_s


def test_at_a_steady_speed_nothing_is_proved(factory, machine):
    still = machine.drive(np.full(1500, 800.0), 6, disturbance_mps=0.0)
    still = [replace(one, speed_mps=1.2 + 0.01 * (k % 2)) for k, one in enumerate(still)]
    supervisor = Supervisor(factory, SETTINGS, PROOF)
    assert supervised(supervisor, still, factory.with_theta(TRUE)) == []


@pytest.mark.parametrize(
    ("learned", "true", "why"),
    [
        (lambda factory: strong(factory, 0.45), lambda factory: strong(factory, 0.45).theta, "margins are too small"),
        (
            lambda factory: factory.with_theta((1.002, *factory.theta[1:])),
            lambda factory: (1.002, *factory.theta[1:]),
            "not stable",
        ),
    ],
)
def test_a_model_that_predicts_better_and_yet_may_not_drive_is_refused(factory, learned, true, why):
    """The machine really is like that, or the errors would refuse it."""
    current_ma = steps(60, 7) if why != "not stable" else np.where(np.arange(300) % 20 < 10, 500.0, 380.0)
    samples = Machine(true(factory), noise_mps=0.003).drive(current_ma, 7)
    supervisor = Supervisor(factory, SETTINGS, PROOF)
    decisions = supervised(supervisor, samples, learned(factory))
    assert why in decisions[0].why
    assert all(one.change is Change.REFUSED for one in decisions)
    assert supervisor.driving is factory


def test_the_factory_model_comes_back_where_the_learned_one_gets_worse_and_nothing_flaps(factory):
    """The machine is another one for two minutes, and then the factory's again."""
    true = Machine(TRUE, noise_mps=0.005)
    samples = true.drive(steps(400, 8), 8, later=Machine(factory.theta), at=700)
    supervisor = Supervisor(factory, SETTINGS, PROOF)
    better = factory.with_theta(TRUE)
    decisions = supervised(supervisor, samples, better)
    assert [one.change for one in decisions[:2]] == [Change.ADOPTED, Change.RETURNED]
    returned = decisions[1]
    assert 140.0 < returned.time_s < 180.0
    assert returned.figures["driving_mps"] > 1.2 * returned.figures["factory_mps"]
    assert supervisor.driving is factory
    assert [one.change for one in decisions[2:]] == [Change.REFUSED]
    assert all(one.time_s < two.time_s for one, two in pairwise(decisions))


def test_the_last_good_model_comes_back_where_it_is_the_better_one(factory):
    good, before = factory.with_theta(TRUE), factory.with_theta((0.72, 3e-4, 2.8e-4, 1.5e-4, -0.03))
    true = Machine(TRUE, noise_mps=0.003)
    supervisor = Supervisor(factory, SETTINGS, PROOF)
    samples = true.drive(steps(200, 9), 9)
    supervised(supervisor, samples, lambda k: before if k < 300 else good)
    assert supervisor.driving is good
    # Upset on purpose: as if what drives had gone bad since.
    supervisor._driving = Shadow(strong(good, 3.0), supervisor._horizon, (), supervisor._driving)
    supervised(supervisor, true.drive(steps(60, 10), 10, start=len(samples)), before)
    returned = next(one for one in supervisor.decisions if one.change is Change.RETURNED)
    assert returned.figures["driving_mps"] > returned.figures["factory_mps"]
    assert supervisor.driving.theta == before.theta


def test_a_hole_takes_the_proof_away_but_not_the_errors(factory, machine):
    supervisor, samples = Supervisor(factory, SETTINGS, PROOF), machine.drive(steps(30, 5), 5)
    better = factory.with_theta(TRUE)
    supervised(supervisor, samples[:100], better)
    known = supervisor.rms_mps
    for _ in range(5):
        supervisor.restart()
        assert supervisor.rms_mps == known
        assert supervised(supervisor, samples[: HORIZON - 1], better) == []
    assert supervisor.rms_mps == known
    assert supervisor.adoptions == 0


@pytest.mark.parametrize("effects", ["gear ratio", "none"])
@pytest.mark.parametrize("gear", [0.0, -1.0])
def test_in_neutral_and_reverse_nobody_is_judged_whether_the_model_knows_gears_or_not(factory, machine, gear, effects):
    known = factory if effects == "gear ratio" else replace(factory, effects=factory.effects[:-1])
    supervisor, samples = Supervisor(known, SETTINGS, PROOF), machine.drive(steps(60, 4), 4)
    samples = [replace(one, signals={**one.signals, "gear": gear}) for one in samples]
    assert supervised(supervisor, samples, known.with_theta(TRUE)) == []
    assert supervisor.proved_s == 0.0
    assert supervisor.rms_mps == {}


def test_rolling_in_neutral_proves_no_gain(factory):
    """The ground moves the machine for a minute; then a gear is engaged, and it keeps its speed."""
    steady_mps, times_s = 0.7, 0.2 * np.arange(1, 401)
    speeds_mps = steady_mps + np.where(times_s < 60.1, 0.3 * np.sin(2.0 * math.pi * times_s / 6.0), 0.0)
    samples = [
        Sample(time_s, 600.0 * (k >= 300), speed_mps, {"engine_speed_rpm": 2000.0, "gear": 2.0 * (k >= 300)})
        for k, (time_s, speed_mps) in enumerate(zip(times_s.tolist(), speeds_mps.tolist(), strict=True))
    ]
    supervisor, weak = Supervisor(factory, SETTINGS, PROOF), strong(factory, 0.75)
    assert supervised(supervisor, samples, weak) == []
    assert supervisor.proved_s == 0.0


def test_a_brake_speaks_against_no_model_nor_is_it_known_as_a_disturbance_after_it(factory):
    """Held back for 5 s of every 12 s, by an operator's foot; the model that drives is the right one."""
    true, supervisor = Machine(TRUE, noise_mps=0.005), Supervisor(factory, SETTINGS, PROOF)
    right = factory.with_theta(TRUE)
    supervised(supervisor, true.drive(steps(60, 4), 4), right)
    assert supervisor.driving is right
    before_mps = supervisor.rms_mps["driving"]
    braked = np.arange(1500) % 60 >= 35
    samples = true.drive(steps(300, 11), 11, start=300, disturbance_mps=np.where(braked, -0.15, 0.0))
    samples = [replace(one, overridden=bool(foot)) for one, foot in zip(samples, braked, strict=True)]
    assert supervised(supervisor, samples, right) == []
    assert supervisor.rms_mps["driving"] < 2.0 * before_mps


def test_a_bad_model_goes_though_half_of_the_time_the_brake_is_pressed(factory):
    supervisor = Supervisor(factory, SETTINGS, PROOF)
    supervisor._driving = supervisor._learned = Shadow(strong(factory, 2.0), supervisor._horizon)
    samples = Machine(factory.theta).drive(steps(60, 12), 12)
    samples = [replace(one, overridden=k % 60 >= 30) for k, one in enumerate(samples)]
    decisions = supervised(supervisor, samples, factory)
    assert decisions[0].change is Change.RETURNED
    assert decisions[0].time_s < 15.0
