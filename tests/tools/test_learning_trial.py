"""The trial of learning while driving: its definitions, a short version, and that it sees what must not happen."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from cruise.control import proof
from cruise.control.controller import ControlSettings
from cruise.control.proof import ProofSettings
from cruise.estimation.supervision import Change, Decision, Finding, SupervisionSettings
from cruise.model import files
from cruise.model.model import Model
from cruise.signals import Sample
from tests.service.drive import CONFIG, plant_settings
from tools.closed_loop import bias, courses, hours
from tools.closed_loop.adaptive import Adaptive, mean
from tools.closed_loop.courses import Course, SetpointRow, laid_over
from tools.closed_loop.drive import FRAME_S
from tools.closed_loop.drivers import Predictive
from tools.closed_loop.hours import Hours

FACTORY = files.load(CONFIG / "factory_model.yaml")
CONTROL = ControlSettings()
SUPERVISION = SupervisionSettings(proof_s=8.0)
ROWS = tuple(SetpointRow(at_s=8.0 * k, to=1.6 if k % 2 else 1.1) for k in range(1, 12))
STEPS = Course(name="steps", seconds=100.0, setpoints=ROWS)
WEAK = laid_over(plant_settings(), {"pump": {"displacement_cm3": 0.8 * plant_settings().pump.displacement_cm3}})


def weaker(model: Model, factor: float) -> Model:
    a, b, loads, c_0 = model.split(model.theta)
    return model.with_theta((*a, *(factor * value for value in b), *loads, factor * c_0))


def driven(learner: Adaptive, seconds: float, plant=WEAK) -> Hours:
    run = Hours()
    fixed = partial(Predictive, FACTORY, CONTROL)
    run.drive(seconds / 3600.0, plant, (STEPS,), learner, fixed, 5, lambda text: None)
    return run


@pytest.fixture(scope="module")
def short() -> tuple[Adaptive, Hours]:
    """Four minutes on a pump that is a fifth too small, which the factory's model does not know."""
    learner = Adaptive(FACTORY, CONTROL, SUPERVISION)
    return learner, driven(learner, 240.0)


def test_the_short_version_keeps_what_is_claimed(short):
    learner, run = short
    figures = {figure.key: figure for figure in run.figures(ProofSettings())}
    assert figures["adopted"].value >= 1
    assert not any(figure.missed for figure in figures.values())
    assert figures["ratio"].value < 1.0
    assert learner.learning.supervisor.driving.dc_gain_mps_per_ma < 0.95 * FACTORY.dc_gain_mps_per_ma
    assert learner.learning.supervisor.driving is learner.controller.adopted


def test_taking_over_is_no_bump(short):
    _, run = short
    assert len(run.bumps_ma) >= 1
    assert max(map(abs, run.bumps_ma)) < hours.BUMP_MA


def test_a_hand_over_that_bumps_is_seen(monkeypatch):
    """The disturbance does not make up for what the new model explains differently."""
    monkeypatch.setattr("cruise.control.observer.DisturbanceObserver.shift", lambda self, more_mps: None)
    learner = Adaptive(FACTORY, CONTROL)
    signals, current_ma = {"gear": 2.0, "engine_speed_rpm": 2000.0}, 790.0
    for k in range(400):
        sample = Sample(FRAME_S * k, current_ma, 1.2, signals)
        if k == 300:
            learner.controller.adopt(weaker(FACTORY, 0.8))
        sent_ma = learner.step(sample, 1.2 if k > 100 else None)
        current_ma = sent_ma if k > 100 else current_ma
    assert abs(learner.controller.bumps_ma[0]) > hours.BUMP_MA


@pytest.mark.parametrize("bad", ["unstable", "negative gain", "small margins"])
def test_a_model_that_may_not_drive_never_does_however_well_it_predicts(monkeypatch, bad):
    """The estimator gives nonsense, and the errors are made to speak for it."""
    _, b, loads, c_0 = FACTORY.split(FACTORY.theta)
    nonsense = {
        "unstable": FACTORY.with_theta((1.05, *(-value for value in b), *loads, c_0)),
        "negative gain": weaker(FACTORY, -1.0),
        "small margins": weaker(FACTORY, 0.4),
    }[bad]
    why = {"unstable": "not stable", "negative gain": "not positive", "small margins": "margins are too small"}[bad]
    monkeypatch.setattr("cruise.estimation.estimator.Estimator.snapshot", lambda self: nonsense)
    monkeypatch.setattr("cruise.estimation.shadow.Shadow._error_mps", lambda self: float(self.model is not nonsense))
    learner = Adaptive(FACTORY, CONTROL, SUPERVISION)
    run = driven(learner, 60.0, plant_settings())
    assert [(one.change, why in one.why) for one in learner.decisions] == [(Change.REFUSED, True)]
    assert learner.controller.adopted is FACTORY
    assert np.array_equal(run.learning[0], run.fixed[0])  # it drove as if it had learned nothing


def test_the_trial_sees_a_learner_that_drives_worse(monkeypatch):
    """Without proof, and with an estimator that is wrong by more than half: the figures say so."""

    def believe(self, *arguments) -> Iterator[Finding]:
        yield Finding("", {"gain_margin": 1.0, "phase_margin_deg": 0.0} | dict.fromkeys(list(hours.MARGINS)[2:], 0.0))

    monkeypatch.setattr(proof.Proof, "__call__", believe)
    monkeypatch.setattr("cruise.estimation.estimator.Estimator.snapshot", lambda self: weaker(FACTORY, 0.4))
    monkeypatch.setattr("cruise.estimation.shadow.Shadow._error_mps", lambda self: float(self.model is FACTORY))
    figures = {one.key: one for one in driven(Adaptive(FACTORY, CONTROL, SUPERVISION), 100.0).figures(ProofSettings())}
    assert figures["worst_above_mps"].missed
    assert figures["gain_margin"].missed
    assert figures["wrong_phase_margin_deg"].missed


def test_every_window_is_five_minutes_and_the_worst_one_counts():
    count = round(hours.WINDOW_S / FRAME_S)
    learning, fixed = np.full(3 * count, 0.02), np.full(3 * count, 0.02)
    learning[count + 100 : 2 * count] = 0.04
    run = Hours(learning=[learning[:700], learning[700:]], fixed=[fixed])
    rows = run.windows()
    assert len(rows) == 1 + round(2 * hours.WINDOW_S / hours.STRIDE_S)
    np.testing.assert_allclose(rows[:, 1], 0.02)
    np.testing.assert_allclose(rows[0, 0], 0.02)
    worst = math.sqrt(0.02**2 * 100 / count + 0.04**2 * (1.0 - 100 / count))
    found = {figure.key: figure for figure in run.figures(ProofSettings())}
    assert found["worst_above_mps"].value == pytest.approx(worst - 1.05 * 0.02 - 0.005)
    assert found["worst_above_mps"].missed
    assert found["worst_learning_mps"].value == pytest.approx(worst)


def test_figures_count_decisions_and_take_the_least_margins():
    margins = dict.fromkeys(hours.MARGINS, 50.0)
    decisions = [
        (0.1, "steps", Decision(9.0, Change.ADOPTED, "it proved itself", margins | {"gain_margin": 2.1})),
        (0.2, "rpm", Decision(9.0, Change.RETURNED, "worse", {})),
        (0.3, "rpm", Decision(9.0, Change.ADOPTED, "it proved itself", margins | {"gain_margin": 1.7})),
        (0.4, "rpm", Decision(9.0, Change.REFUSED, "its margins are too small", {"gain_margin": 1.0})),
    ]
    still = [np.zeros(10)]
    run = Hours(learning=still, fixed=[np.ones(10)], decisions=decisions, bumps_ma=[0.5, -6.0])
    found = {figure.key: figure for figure in run.figures(ProofSettings())}
    assert [found[key].value for key in ("adopted", "returned", "refused")] == [2, 1, 1]
    assert (found["gain_margin"].value, found["gain_margin"].missed) == (1.7, True)
    assert (found["bump_ma"].value, found["bump_ma"].missed) == (6.0, True)
    assert run.as_json()[3] == {
        "hour": 0.4,
        "course": "rpm",
        "time_s": 9.0,
        "change": "refused",
        "why": "its margins are too small",
        "gain_margin": 1.0,
    }


def test_the_machine_wears_and_every_course_is_driven():
    rng = np.random.default_rng(1)
    plant = plant_settings()
    sizes = [hours.machine_at(plant, hour, rng).pump.displacement_cm3 for hour in (0.0, 0.75, 1.9, 2.1, 3.1)]
    assert sizes[0] == plant.pump.displacement_cm3
    assert sizes[1] == pytest.approx(1.12 * sizes[0])
    assert sizes[3] < 0.88 * sizes[2] < 0.88 * sizes[4]
    known = courses.load()
    found = [course.name for course, _ in zip(hours.itinerary(known, rng), range(2 * len(known)), strict=False)]
    assert set(found[: len(known)]) == set(found[len(known) :]) == {course.name for course in known}


def test_a_sample_is_the_mean_of_its_frames():
    frames = [
        Sample(0.05 * k, 700.0 + k, 1.0 + k, {"gear": 2.0, "pitch_deg": float(k)}, engaged=True) for k in range(4)
    ]
    whole = mean(frames, 1.3)
    assert (whole.time_s, whole.current_ma, whole.speed_mps) == pytest.approx((0.15, 701.5, 2.5))
    assert whole.signals == {"gear": 2.0, "pitch_deg": 1.5}
    assert (whole.reference_mps, whole.engaged) == (1.3, True)


def test_the_deaf_law_drives_by_its_model_alone():
    currents = []
    for speed_mps in (1.2, 1.0):
        driver = Adaptive(FACTORY, bias.deaf(CONTROL))
        sample = Sample(0.0, 790.0, 1.2, {"gear": 2.0, "engine_speed_rpm": 2000.0})
        driver.step(sample, None)
        currents.append([])
        for k in range(1, 100):
            sample = replace(sample, time_s=FRAME_S * k, speed_mps=speed_mps, current_ma=(currents[-1] or [790.0])[-1])
            currents[-1].append(driver.step(sample, 1.4))
    np.testing.assert_allclose(*currents, atol=0.5)
    assert currents[0][-1] > 800.0


def test_the_bias_is_measured_beside_a_fit_in_open_loop():
    part = bias.measure(WEAK, FACTORY, (STEPS,), 3)
    found = {figure.key: figure.value for figure in part.figures}
    assert found["bias_open_gain_pct"] == 0.0
    assert found["bias_factory_gain_pct"] > 10.0
    assert abs(found["bias_batch_gain_pct"]) < found["bias_factory_gain_pct"]
    assert found["bias_open_error_mps"] < found["bias_factory_error_mps"]
    assert all(math.isfinite(value) for value in found.values())
