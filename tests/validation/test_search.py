"""What is judged has not been seen, gains count what the losses say, and sureness what the blocks of time agree on."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.dead_zone import DeadZone
from cruise.effects.grade import Grade
from cruise.model import prediction
from cruise.model.core import Core
from cruise.recording import Recording
from cruise.signals import OUTPUT
from cruise.validation.candidates import EffectCandidate, UnnamedCandidate, with_effect
from cruise.validation.disturbance import Disturbance
from cruise.validation.explanation import Explanation
from cruise.validation.fitting import Fit, Objective, fit
from cruise.validation.judged import Judged, gain, sureness
from cruise.validation.search import BLOCK_S, FOLDS, SETTLED, Search
from cruise.validation.simulation import Scene
from cruise.validation.told import kinds_of
from tests.validation.driving import GAIN, OFFSET_MPS, drive, wander

ZONE = EffectCandidate("dead_zone", told=kinds_of("dead_zone"))
START = Explanation(Core(GAIN, 0.35, 0.15, 0.6, 0.05), (), (), OFFSET_MPS)


def search_of(*recordings: Recording, horizon_s: float = 3.0) -> Search:
    scene = Scene(recordings, sorted({*recordings[0].columns, OUTPUT}), None, horizon_s)
    return Search(scene, 1.0, GAIN / 3.0, frozenset({"dead_zone.jump_share"}))  # by its kind, as ever in a search


def recorded(seconds: float = 240.0, seed: int = 1, **hidden) -> Recording:
    samples = round(seconds / 0.2)
    columns = {"useless": wander(samples, 0.2, 300 + seed, 1.0, 3.0)}
    return drive(seconds, seed, 0.2, 0.03, columns=columns, **hidden)


def hand_made(raw, white=None, weight=None) -> Judged:
    raw = np.asarray(raw, float)
    white = raw if white is None else np.asarray(white, float)
    weight = np.ones(len(raw)) if weight is None else np.asarray(weight, float)
    found = search_of(recorded(40.0)).fitted(START, steps=1)
    return Judged("", found, (), np.zeros(0), raw, white, weight)


def slow_servo(current_ma: np.ndarray) -> np.ndarray:
    """A lag of 1 s."""
    rest = np.exp(-0.2 / 1.0)
    return np.asarray(signal.lfilter([1.0 - rest], [1.0, -rest], current_ma, zi=[rest * current_ma[0]])[0])


# -- gain and sureness


def test_a_loss_is_the_mean_over_samples_not_over_blocks():
    one = hand_made([1.0, 4.0], [2.0, 5.0], [3.0, 1.0])
    assert one.loss == pytest.approx((3.0 + 4.0) / 4.0)
    assert one.white_loss == pytest.approx((6.0 + 5.0) / 4.0)


def test_a_gain_counts_raw_and_whitened_errors_alike():
    before = hand_made([1.0, 1.0, 4.0], [2.0, 2.0, 2.0])
    after = hand_made([0.25, 0.25, 1.0], [1.0, 1.0, 1.0])
    assert gain(before, after) == pytest.approx(1.0 - np.sqrt(0.25 * 0.5))
    assert gain(before, before) == pytest.approx(0.0)
    assert gain(after, before) == pytest.approx(1.0 - np.sqrt(8.0))


def test_what_all_blocks_say_is_sure_and_what_one_says_is_not():
    rng = np.random.default_rng(1)
    before = 1.0 + 0.1 * rng.standard_normal(12)
    everywhere = before * (0.8 + 0.02 * rng.standard_normal(12))
    in_one = before.copy()
    in_one[0] = 12.0
    cured = in_one.copy()
    cured[0] = 12.0 * 0.6
    sure = sureness(hand_made(before), hand_made(everywhere), np.random.default_rng(2))
    unsure = sureness(hand_made(in_one), hand_made(cured), np.random.default_rng(2))
    assert gain(hand_made(in_one), hand_made(cured)) > gain(hand_made(before), hand_made(everywhere))
    assert sure > 15.0
    assert 0.5 < unsure < 2.5
    assert sureness(hand_made(everywhere), hand_made(before), np.random.default_rng(2)) < -15.0
    assert sureness(hand_made(before), hand_made(before), np.random.default_rng(2)) == 0.0


def test_sureness_is_the_standard_error_of_the_mean_log_ratio():
    rng = np.random.default_rng(3)
    ratios = np.exp(-0.1 + 0.15 * rng.standard_normal(60))
    expected = -np.mean(np.log(ratios)) / (np.std(np.log(ratios)) / np.sqrt(60))
    found = sureness(hand_made(np.ones(60)), hand_made(ratios), np.random.default_rng(4))
    assert found == pytest.approx(expected, rel=0.25)


@pytest.mark.parametrize(("blocks", "share"), [(1, 0.0), (3, 0.0), (4, 0.68), (6, 0.92), (8, 1.0), (60, 1.0)])
def test_few_blocks_are_never_sure(blocks, share):
    """Draws from one block are all alike; from three, t has no spread at all."""
    ratios = np.exp(-0.5 + 0.4 * np.resize([-1.0, 1.0], blocks))
    found = sureness(hand_made(np.ones(blocks)), hand_made(ratios), np.random.default_rng(4))
    usual = 0.5 / max(0.4 / np.sqrt(blocks), 1e-9)
    assert found == pytest.approx(share * usual, rel=0.2)


def test_sureness_weighs_blocks_by_their_samples():
    before = hand_made(np.ones(12), weight=[1e-9] * 6 + [50.0] * 6)
    after = hand_made([3.0] * 6 + [0.7, 0.8, 0.7, 0.8, 0.7, 0.8], weight=[1e-9] * 6 + [50.0] * 6)
    assert sureness(before, after, np.random.default_rng(5)) > 5.0


# -- held out


def test_blocks_are_twenty_seconds_and_end_with_their_recording():
    search = search_of(recorded(130.0), recorded(50.0, 2), recorded(12.0, 3))
    sizes = np.bincount(search.blocks)
    assert len(sizes) == round(130.0 / BLOCK_S) + round(50.0 / BLOCK_S) + 1
    assert np.all(np.diff(search.blocks) >= 0)
    first = {int(search.blocks[part.start]) for part in search.scene.parts}
    last = {int(search.blocks[part.stop - 1]) + 1 for part in search.scene.parts}
    assert first == {0, *last} - {len(sizes)}
    assert sizes.max() * 0.2 <= 1.5 * BLOCK_S


def test_every_fold_has_the_numbers_that_a_fit_without_it_finds():
    """One step from the full fit is worth a whole fit: the rest of the recording is explained as well by both."""
    search = search_of(recorded(240.0, command=lambda u: np.maximum(u - 400.0, 0.0)))
    found = search.settled(search.fitted(with_effect(START, DeadZone(350.0))))
    judged = search.judged("dead_zone", found)
    plan = replace(found.layout, start=found.explanation)
    assert len(judged.folds) == FOLDS
    linear = [i for i, slot in enumerate(plan.slots) if slot.name in ("gain_mps_per_ma", "offset_mps")]
    left = []
    for fold, vector in enumerate(judged.folds):

        class Unheld(Scene):
            unseen = search.blocks % FOLDS == fold

            def errors(self, batch):
                return np.where(self.unseen, np.nan, super().errors(batch))

        scene = Unheld(search.scene.recordings, list(search.scene.signals))
        objective = Objective(scene, plan)
        full, step, exact = (
            float(np.sum(objective.residual(one) ** 2))
            for one in (found.vector, vector, fit(scene, plan, 100, SETTLED).vector)
        )
        assert step < full
        assert step < exact + 0.001 * full
        pulls = []
        for one in (found.vector, vector):
            error, slopes = objective.differences(one)
            pulls.append((slopes * plan.scale)[:, linear].T @ error)
        left.append(np.abs(pulls[1]) / np.abs(pulls[0]))
    assert np.all(np.median(left, axis=0) < 0.08)  # a sixth would be left by a step that counts the held-out part


def test_what_a_bound_holds_at_nothing_takes_nothing_off_the_held_out_error():
    """A slope that would have to push: a fold must not keep the numbers of the full fit because it can't follow."""
    one = recorded(240.0)
    hills = wander(len(one), 0.2, 7, 3.0, 10.0)
    pushed = replace(one, columns={**one.columns, OUTPUT: one.output + 0.02 * hills, "pitch_deg": hills})
    search = search_of(pushed)
    bare = search.judged("", search.settled(search.fitted(START)))
    held = search.judged("grade", search.settled(search.grown(bare.explanation, EffectCandidate("grade"))))
    assert held.explanation.loads[-1] == pytest.approx(0.0, abs=1e-6)
    assert held.fit.cost == pytest.approx(bare.fit.cost, rel=1e-3)
    assert bare.loss > 1.005 * bare.fit.cost
    assert held.loss == pytest.approx(bare.loss, rel=2e-3)


def test_every_sample_is_judged_by_the_fold_that_has_not_seen_it():
    search = search_of(recorded(160.0))
    found = search.fitted(START)
    judged = search.judged("", found)
    for fold, vector in enumerate(judged.folds):
        held = search.blocks % FOLDS == fold
        (errors,) = search.scene.errors([found.layout.explanation(vector)])
        np.testing.assert_allclose(judged.error_mps[held], errors[held])
    known = np.isfinite(judged.error_mps)
    np.testing.assert_array_equal(known, search.scene.judged)
    assert judged.loss == pytest.approx(np.mean(judged.error_mps[known] ** 2))
    assert judged.white_loss == pytest.approx(judged.loss)
    assert judged.loss > found.cost
    low, high = found.layout.bounds
    assert all(np.all((low <= vector) & (vector <= high)) for vector in judged.folds)


def test_the_loss_is_of_what_is_whitened_where_a_disturbance_is_known():
    search = search_of(recorded(160.0))
    found = search.fitted(START)
    search.disturbance = Disturbance((0.5,), search.starts)
    judged = search.judged("", found)
    objective = search.scene.errors([found.layout.explanation(vector) for vector in judged.folds])
    by_hand = objective[:, 1:] - 0.5 * objective[:, :-1]
    mine = by_hand[search.blocks[1:] % FOLDS, np.arange(len(search.blocks) - 1)]
    known = np.isfinite(mine)
    assert judged.white_loss == pytest.approx(np.mean(mine[known] ** 2), rel=0.01)
    assert judged.loss == pytest.approx(np.nanmean(judged.error_mps**2))


def test_useless_numbers_fit_better_and_hold_out_no_better():
    """Four further coefficients on a signal that has nothing to do with the speed, on five recordings."""
    gains, costs = [], []
    for seed in range(5):
        search = search_of(recorded(160.0, seed))
        base = search.fitted(START)
        grown = search.grown(base.explanation, UnnamedCandidate("useless", 0.0, 2.0))
        costs.append(grown.cost / base.cost)
        gains.append(gain(search.judged("", base), search.judged("useless", grown)))
    assert np.mean(costs) < 1.0 - 0.003
    assert np.mean(gains) < 0.0
    assert max(gains) < 0.02


def test_what_is_there_is_a_sure_gain():
    search = search_of(recorded(160.0, command=lambda u: np.maximum(u - 350.0, 0.0)))
    base = search.fitted(START)
    grown = search.grown(base.explanation, ZONE)
    before, after = search.judged("", base), search.judged("dead_zone", grown)
    assert gain(before, after) > 0.5
    assert sureness(before, after, np.random.default_rng(1)) > 2.0
    assert after.candidate == "dead_zone"
    assert after.explanation.names == ("dead_zone",)


def test_of_several_starts_the_one_that_leads_deepest_is_kept():
    """From a threshold below every current no fit finds the way: there it is an offset and nothing else."""
    search = search_of(recorded(160.0, command=lambda u: np.maximum(u - 400.0, 0.0)))
    base = search.fitted(START)
    each = [search.fitted(option).cost for option in ZONE.grown(base.explanation)]
    assert max(each) > 3.0 * min(each)
    assert search.grown(base.explanation, ZONE).cost <= 1.02 * min(each)


# -- the discrete model


def test_the_error_ahead_is_that_of_the_discrete_models_of_the_folds():
    one, other = recorded(160.0), recorded(60.0, 2)
    search = search_of(one, other)
    judged = search.judged("", search.fitted(with_effect(START, CoulombFriction(0.3))))
    squares = []
    for fold, vector in enumerate(judged.folds):
        model = judged.fit.layout.explanation(vector).model(0.2)
        for part, each in zip(search.scene.parts, (one, other), strict=True):
            error = each.output - prediction.ahead(model, each.input, each.output, each.columns, 10)
            squares.append(error[(search.blocks[part] % FOLDS == fold) & np.isfinite(error)] ** 2)
    error_mps = search.scene.speed_mps - search.unseen_ahead_mps(judged, 10)
    assert np.nanmean(error_mps**2) == pytest.approx(np.mean(np.concatenate(squares)))
    assert np.isfinite(error_mps).sum() == len(np.concatenate(squares))


# -- what nobody recorded


def test_the_disturbance_is_learned_from_what_no_candidate_explains():
    """Half of the residual is a dead zone's: it must not be learned as if it were the soil's."""
    soil = wander(1200, 0.2, 8, 0.05, 0.3)
    whole = drive(240.0, 2, 0.2, 0.005, load_mps=soil, columns={"useless": soil[::-1]})
    lacking = drive(240.0, 2, 0.2, 0.005, lambda u: np.maximum(u - 400.0, 0.0), load_mps=soil)
    learned = {}
    for name, one, others in (("whole", whole, ()), ("without", lacking, ()), ("with", lacking, (ZONE,))):
        search = search_of(one)
        base = search.fitted(START)
        search.learn_disturbance(base, [search.grown(base.explanation, other) for other in others])
        learned[name] = np.array(search.disturbance.coefficients)
        assert search.disturbance.starts == (0,)
    assert np.linalg.norm(learned["with"] - learned["whole"]) < 0.4 * np.linalg.norm(
        learned["without"] - learned["whole"]
    )


def test_a_fit_that_settles_ends_at_the_bottom_of_the_valley():
    search = search_of(recorded(160.0, command=lambda u: np.maximum(u - 400.0, 0.0)))
    begun = search.begun(search.fitted(START).explanation, ZONE)
    settled = search.settled(begun)
    (effect,) = settled.explanation.effects
    assert isinstance(effect, DeadZone)
    assert effect.threshold_ma == pytest.approx(400.0, abs=5.0)
    assert settled.cost < begun.cost
    assert search.settled(settled).cost == pytest.approx(settled.cost, rel=1e-4)


def test_an_effect_that_stands_in_the_wrong_valley_begins_anew():
    """Below every current a dead zone is an offset: no step from there leads to where it acts."""
    search = search_of(recorded(160.0, command=lambda u: np.maximum(u - 400.0, 0.0)))
    stuck = search.fitted(with_effect(START, DeadZone(24.0, 4.5)))
    assert search.settled(stuck).cost > 0.9 * stuck.cost
    assert search.regrown(stuck).cost < 0.5 * stuck.cost


# -- shapes that are looked for only where they are worth it


PITCH_DEG = wander(1200, 0.2, 21, 3.0, 6.0)
LOSS_MPS = 3.0 * np.sin(np.radians(PITCH_DEG))
LEVEL_MPS = drive(240.0, 1, 0.2, 0.0).output  # as it would drive without any slope


def graded(load_mps: np.ndarray) -> tuple[Search, Fit]:
    """A drive that loses so much by its slope, or by something else, and the fit of a grade in it."""
    search = search_of(drive(240.0, 1, 0.2, 0.03, columns={"pitch_deg": PITCH_DEG}, load_mps=load_mps))
    search.fixed = frozenset({"grade.acceleration_share", "grade.mass_share"})
    return search, search.grown(search.fitted(START).explanation, EffectCandidate("grade"))


@pytest.mark.parametrize(
    ("load_mps", "freed"),
    [
        (-LOSS_MPS, False),  # leakage: the same at any stroke
        (-LOSS_MPS * LEVEL_MPS / 1.5, True),  # a pump that gives up a share of its stroke
        (wander(1200, 0.2, 22, 0.3, 6.0), False),  # no slope at all
    ],
)
def test_a_loss_that_grows_with_the_stroke_is_looked_for_where_it_errs_far_less(load_mps, freed):
    search, plain = graded(load_mps)
    assert "stroke_share" in plain.explanation.effects[0].idle
    other = search.freed(plain, "grade")
    (effect,) = other.explanation.effects
    assert isinstance(effect, Grade)
    assert (effect.stroke_share > 0.7) is freed
    assert (other is plain) is not freed
    assert search.freed(other, "grade") is other
    assert search.freed(plain, "coulomb_friction") is plain


def test_what_wheels_slip_is_no_loss_of_the_stroke():
    """A share of the speed is what slip is, too: it can be no more than wheel and ground speed show."""
    search, plain = graded(-LOSS_MPS * LEVEL_MPS / 1.5)
    search.slip_mps = 0.1
    assert search.freed(plain, "grade") is plain
    search.slip_mps = 0.01
    assert search.freed(plain, "grade") is not plain


def test_a_model_is_freed_in_all_that_it_has():
    search, plain = graded(-LOSS_MPS * LEVEL_MPS / 1.5)
    bare, judged = (search.judged("", one) for one in (search.fitted(START), plain))
    assert search.all_freed(bare) is bare
    freed = search.all_freed(judged)
    assert freed.loss < 0.7 * judged.loss
    assert search.all_freed(freed) is freed


@pytest.mark.parametrize(("moves_s", "size_mps"), [(1.5, 6.0), (5.0, 10.0)])
def test_a_slow_servo_with_a_load_behind_it_is_found_though_a_fit_holds_the_vehicle_for_slow(moves_s, size_mps):
    pitch = wander(1200, 0.2, 21, 3.0, moves_s)
    load_mps = -size_mps * np.sin(np.radians(pitch))
    search = search_of(
        drive(240.0, 2, 0.2, 0.005, slow_servo, load_mps=load_mps, vehicle_s=0.1, columns={"pitch_deg": pitch})
    )
    core = replace(START.core, lag_s=0.1, time_constant_s=1.0)
    held, grade = search.fitted(replace(START, core=core)).explanation, EffectCandidate("grade")
    assert held.core.time_constant_s > 1.0
    near, anew = search.grown(held, grade), search.grown_anew(held, grade)
    assert anew.cost < 0.3 * near.cost
    assert anew.explanation.core.time_constant_s < 0.5
