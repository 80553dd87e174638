"""The search over orders and delay: a known structure comes back, and all are judged alike."""

import numpy as np
import pytest

from cruise.identification.accuracy import accuracy
from cruise.identification.arx import fit_arx
from cruise.identification.held_out import folds
from cruise.identification.orders import Search, search
from cruise.identification.preparation import PreparationSettings, smoother
from cruise.identification.regressors import FitError
from cruise.model.model import Model
from tests.identification.truth import EFFECTS
from tests.identification.truth import recording as curved
from tools.benchmarks.recovery import SYSTEMS, currents, recording

PLAIN = Model(0.2, 1, 1, 0, (), (0.0,) * 3)
NA, NB, DELAYS, HORIZON_S = range(4), range(1, 4), range(5), 3.0


@pytest.fixture(scope="module")
def found() -> Search:
    """Of y = 1.2 y_1 - 0.35 y_2 + b_0 u_2 + b_1 u_3 + e."""
    return search(PLAIN, [SYSTEMS["arx"].record(seed) for seed in (1, 2)], NA, NB, DELAYS, HORIZON_S)


def test_the_true_structure_is_recommended(found):
    one = found.recommended
    assert (one.na, one.nb, one.delay) == (2, 2, 2)
    assert one.parameters == 5


def test_every_structure_stands_there_once_the_best_first(found):
    assert len({(one.na, one.nb, one.delay) for one in found.candidates}) == len(found.candidates) == 60
    errors = [one.rmse_mps for one in found.candidates if not one.refused]
    assert errors == sorted(errors)
    refused = [bool(one.refused) for one in found.candidates]
    assert refused == sorted(refused)


def test_the_front_holds_what_no_simpler_one_beats(found):
    usable = [one for one in found.candidates if not one.refused]
    front = set(map(id, found.front))
    assert found.recommended in found.front
    for one in usable:
        beaten = any(
            other is not one and other.parameters <= one.parameters and other.rmse_mps <= one.rmse_mps
            for other in usable
        )
        assert (id(one) in front) != beaten


def test_the_recommended_one_is_within_a_standard_error_and_nothing_smaller_is(found):
    best = found.candidates[0]

    def worse(one):
        more = one.power_m2ps2 - best.power_m2ps2
        return more.mean() / (more.std(ddof=1) / np.sqrt(len(more)))

    assert found.recommended is best or worse(found.recommended) <= 1.0
    for one in found.candidates:
        if not one.refused and one.parameters < found.recommended.parameters:
            assert worse(one) > 1.0


@pytest.mark.parametrize("orders", [(1, 1, 0), (2, 2, 2), (0, 3, 4)])
def test_all_are_judged_on_the_same_unseen_samples(found, orders):
    parts = [SYSTEMS["arx"].record(seed) for seed in (1, 2)]
    na, nb, delay = orders
    structure = Model(0.2, na, nb, delay, (), (0.0,) * (na + nb + 1))
    first = max(NA) + max(NB) + max(DELAYS) + 15  # all of them can predict from here
    predicted = [np.full(len(one), np.nan) for one in parts]
    for fold in folds(parts):
        fitted = fit_arx(structure, fold.training)
        for one, unseen, result in zip(parts, fold.unseen, predicted, strict=True):
            result[unseen] = fitted.ahead(one, 15)[unseen]
    for result in predicted:
        result[:first] = np.nan
    by_hand = accuracy([one.output for one in parts], predicted)
    (mine,) = (one for one in found.candidates if (one.na, one.nb, one.delay) == orders)
    assert mine.rmse_mps == pytest.approx(by_hand.rmse_mps, rel=1e-9)
    assert mine.explained_pct == pytest.approx(by_hand.explained_pct, rel=1e-9)
    assert by_hand.samples == sum(len(one) - first for one in parts)


def test_more_taps_than_the_truth_are_not_recommended_for_being_a_little_better(found):
    holding_it = [one for one in found.candidates if one.na >= 2 and one.delay <= 2 and one.delay + one.nb >= 4]
    larger = [one for one in holding_it if not one.refused]
    assert len(larger) > 5
    assert max(one.rmse_mps for one in larger) < 1.2 * found.recommended.rmse_mps
    assert all(one.parameters >= found.recommended.parameters for one in larger)


def test_the_effects_are_those_of_the_model_and_named():
    base = Model(0.2, 1, 1, 0, EFFECTS, (0.0,) * 3)
    parts = [curved(600, seed, 0.01) for seed in (1, 2)]
    found = search(base, parts, range(1, 3), range(1, 3), range(1, 4), HORIZON_S)
    assert found.effects == ("dead_zone", "quadratic_gain", "engine_speed", "gear_ratio")
    assert (found.recommended.na, found.recommended.nb, found.recommended.delay) == (1, 2, 2)
    without = search(PLAIN, parts, range(1, 2), range(2, 3), range(2, 3), HORIZON_S)
    assert without.effects == ()
    assert without.recommended.rmse_mps > 2.0 * found.recommended.rmse_mps


def test_an_unstable_one_has_no_figures_but_a_reason():
    rng = np.random.default_rng(3)
    growing = recording(currents(rng, 600), 0.1 * np.exp(np.arange(600) / 150.0) + 0.01 * rng.standard_normal(600))
    found = search(PLAIN, [growing], range(2), range(1, 2), range(1), HORIZON_S)
    (one,) = (one for one in found.candidates if one.na == 1)
    assert one.refused.startswith("unstable: pole at 1.0")
    assert np.isnan([one.rmse_mps, one.explained_pct, *one.power_m2ps2]).all()
    assert found.candidates[-1] is one
    assert one not in found.front
    assert found.recommended.na == 0


def test_progress_is_told():
    told = []
    search(PLAIN, [SYSTEMS["arx"].record(1)], range(2), range(1, 2), range(2), 1.0, show=lambda *at: told.append(at))
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_the_filter_is_that_of_the_fit_and_of_the_prediction():
    one, smooth = SYSTEMS["arx"].record(5), smoother(PreparationSettings(), 0.2)
    orders = range(1, 2), range(2, 3), range(2, 3)
    plain, fitted, both = (
        search(PLAIN, [one], *orders, 1.0, of_fit, of_prediction).recommended.rmse_mps
        for of_fit, of_prediction in ((None, None), (smooth, None), (smooth, smooth))
    )
    assert len({plain, fitted, both}) == 3


@pytest.mark.parametrize(
    ("samples", "na", "delays", "says"),
    [
        (600, range(1), range(1), "no structure to search: give a greatest na or nb of 1 or more"),
        (40, range(2), range(1), r"none of 2 structures can be judged; the first one: .*record for longer"),
        (100, range(1, 2), range(80, 81), r"a held-out part has no prediction: .*shorter delays|usable samples"),
    ],
)
def test_a_search_that_finds_nothing_says_why(samples, na, delays, says):
    nb = range(1) if says.startswith("no structure") else range(1, 2)
    with pytest.raises(FitError, match=says):
        search(PLAIN, [SYSTEMS["arx"].record(6)[:samples]], na, nb, delays, HORIZON_S)
