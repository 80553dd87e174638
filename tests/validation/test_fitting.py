"""Fits find what a recording was made with, within the errors that they state, and keep their bounds."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.dead_zone import DeadZone
from cruise.effects.grade import Grade
from cruise.effects.hysteresis import Hysteresis
from cruise.effects.power_limit import PowerLimit
from cruise.effects.quadratic_gain import QuadraticGain
from cruise.effects.saturation import Saturation
from cruise.model import prediction
from cruise.model.core import Core
from cruise.recording import Recording, resample
from cruise.signals import OUTPUT
from cruise.validation.candidates import DelayCandidate, EffectCandidate, ResonanceCandidate, without
from cruise.validation.explanation import CORE, Explanation
from cruise.validation.fitting import FAR, Fit, Objective, fit, layout
from cruise.validation.search import Search
from cruise.validation.simulation import Scene
from tests.validation.driving import (
    DELAY_S,
    GAIN,
    GRAVITY_MPS2,
    LAG_S,
    OFFSET_MPS,
    SECOND_LAG_S,
    VEHICLE_S,
    drive,
    levels,
    wander,
)

PERIOD_S = 0.2
TRUE = Core(GAIN, 0.33, 0.15, VEHICLE_S, 0.08)
START = Explanation(replace(TRUE, gain_mps_per_ma=0.8 * GAIN, delay_s=0.2, lag_s=0.25, time_constant_s=1.0))


def search_of(*recordings: Recording, longest_delay_s: float = 1.0, fixed: frozenset[str] = frozenset()) -> Search:
    scene = Scene(recordings, sorted({*recordings[0].columns, OUTPUT}))
    return Search(scene, longest_delay_s, GAIN / 3.0, fixed)


def numbers(search: Search, found: Fit) -> dict[str, tuple[float, float]]:
    """Every fitted number by name, with its standard error."""
    std = np.sqrt(np.diag(search.covariance(found)))
    names = [
        slot.name if slot.owner in ("core", "offset") else f"{slot.owner}.{slot.name}" for slot in found.layout.slots
    ]
    return {name: (float(value), float(error)) for name, value, error in zip(names, found.vector, std, strict=True)}


def by_the_model(truth: Explanation, seed: int, seconds: float = 300.0, noise_mps: float = 0.03) -> Recording:
    """What the discrete model itself drives, with noise: nothing but the noise is left to a fit."""
    samples = round(seconds / PERIOD_S)
    u = levels(samples, PERIOD_S, seed, 100.0, 900.0)
    columns = {"pitch_deg": wander(samples, PERIOD_S, seed, 2.0, 5.0)}
    model = truth.model(PERIOD_S)
    longer = replace(model, nb=40, theta=(*model.theta[:1], *(0.0,) * 40, *model.theta[1 + model.nb :]))
    depth = longer.delay + longer.nb
    started = {name: np.concatenate([np.full(depth, column[0]), column]) for name, column in columns.items()}
    before = np.concatenate([np.full(depth, u[0]), u])
    steady = truth.core.gain_mps_per_ma * u[0] + truth.offset_mps
    free = prediction.free_run(truth.model(PERIOD_S, longer), before, np.full(len(before), steady), started)[depth:]
    speed = free + noise_mps * np.random.default_rng(40 + seed).standard_normal(samples)
    return Recording(
        PERIOD_S * np.arange(1, samples + 1), {"pump_current_ma": u, OUTPUT: speed, **columns}, PERIOD_S, f"{seed}.csv"
    )


def test_without_noise_the_core_is_found_to_the_last_digits():
    truth = Explanation(TRUE, (), (), OFFSET_MPS)
    search = search_of(by_the_model(truth, 1, noise_mps=0.0))
    found = search.fitted(START)
    core = found.explanation.core
    assert core.gain_mps_per_ma == pytest.approx(GAIN, rel=2e-4)
    assert core.time_constant_s == pytest.approx(VEHICLE_S, abs=0.01)
    assert core.delay_s + core.lag_s + core.second_lag_s == pytest.approx(0.33 + 0.15 + 0.08, abs=0.02)
    assert found.explanation.offset_mps == pytest.approx(OFFSET_MPS, abs=1e-3)
    assert found.cost < 1e-6
    assert found.explanation.structural == frozenset()


SEEDS = range(8)
NEUTRAL = frozenset(
    {
        "dead_zone.edge_ma",
        "dead_zone.jump_share",
        "grade.mass_share",
        "grade.acceleration_share",
        "grade.filter_s",
    }
)
SCATTERED = Explanation(TRUE, (DeadZone(300.0), Grade()), (0.3,), OFFSET_MPS)


@pytest.fixture(scope="module")
def scattered() -> list[dict[str, tuple[float, float]]]:
    """Fits of one truth to recordings that differ by current, slope and noise."""
    results = []
    for seed in SEEDS:
        search = search_of(by_the_model(SCATTERED, seed), fixed=NEUTRAL)
        start = replace(START, effects=(DeadZone(250.0), Grade()), loads=(0.0,))
        results.append(numbers(search, search.fitted(start)))
    return results


@pytest.mark.parametrize(
    ("name", "truth"),
    [
        ("gain_mps_per_ma", GAIN),
        ("time_constant_s", VEHICLE_S),
        ("offset_mps", OFFSET_MPS),
        ("grade.load", 0.3),
        ("dead_zone.threshold_ma", 300.0),
    ],
)
def test_the_standard_errors_are_those_of_the_scatter(scattered, name, truth):
    off = np.array([one[name][0] - truth for one in scattered])
    stated = np.array([one[name][1] for one in scattered])
    assert np.all(stated > 0.0)
    # Chi-square of 8: within 2.7 to 15.5 of 8 by 90 %; the sandwich of 15 blocks states up to a fifth too little.
    assert 0.45 < np.sqrt(np.mean((off / stated) ** 2)) < 1.8
    assert abs(off.mean()) < 3.5 * np.sqrt(np.mean(stated**2) / len(off))


def test_the_errors_count_what_lasts():
    """The same noise, once white and once lasting 2 s: what lasts tells less, and the sandwich says so."""
    plain = by_the_model(Explanation(TRUE, (), (), OFFSET_MPS), 1, noise_mps=0.0)
    rng = np.random.default_rng(3)
    white = 0.03 * rng.standard_normal(len(plain))
    lasting = wander(len(plain), PERIOD_S, 3, 0.03, 2.0)
    errors = []
    for noise in (white, lasting):
        noisy = Recording(plain.time_s, {**plain.columns, OUTPUT: plain.output + noise}, PERIOD_S, "n.csv")
        search = search_of(noisy)
        errors.append(numbers(search, search.fitted(START))["offset_mps"][1])
    assert errors[1] > 2.0 * errors[0]


SLOPE = wander(2400, 0.1, 7, 2.0, 5.0)


def play(u: np.ndarray, width_ma: float) -> np.ndarray:
    result = np.empty(len(u))
    state = u[0]
    for i, value in enumerate(u):
        state = min(max(state, value - 0.5 * width_ma), value + 0.5 * width_ma)
        result[i] = state
    return result


HIDDEN = {
    "dead_zone": ({"command": lambda u: np.maximum(u - 350.0, 0.0)}, {"dead_zone.threshold_ma": 350.0}),
    "saturation": ({"command": lambda u: np.minimum(u, 700.0)}, {"saturation.full_stroke_ma": 700.0}),
    "hysteresis": ({"command": lambda u: play(u, 80.0)}, {"hysteresis.width_ma": 80.0}),
    "quadratic_gain": ({"command": lambda u: u * (1.0 + 0.5 * u / 1000.0)}, {"quadratic_gain.curvature": 0.5}),
    "grade": ({"load_mps": -0.4 * GRAVITY_MPS2 * np.sin(np.radians(SLOPE))}, {"grade.load": 0.4}),
}


@pytest.mark.parametrize("effect", HIDDEN)
def test_a_hidden_effect_is_measured_by_its_fit(effect):
    """On a machine with continuous dynamics."""
    hidden, truth = HIDDEN[effect]
    one = drive(240.0, 3, 0.1, 0.02, columns={"pitch_deg": SLOPE}, **hidden)
    search = search_of(one, fixed=frozenset({"grade.acceleration_share"}))
    base = search.fitted(START)
    found = search.grown(base.explanation, EffectCandidate(effect))
    assert found.cost < 0.3 * base.cost
    assert np.sqrt(np.nanmean(found.error_mps**2)) == pytest.approx(0.02, rel=0.12)
    fitted = numbers(search, found)
    for name, value in {**truth, "gain_mps_per_ma": GAIN, "offset_mps": OFFSET_MPS}.items():
        found_value, std = fitted[name]
        assert abs(found_value - value) < 4.0 * std + 0.01 * abs(value), name
    core = found.explanation.core
    # A slope that is seen through a low-pass of its own and the vehicle's lag are hard to tell apart.
    assert core.time_constant_s == pytest.approx(VEHICLE_S, rel=0.12 if effect == "grade" else 0.03)
    total_s = core.delay_s + core.lag_s + core.second_lag_s
    assert total_s == pytest.approx(DELAY_S + LAG_S + SECOND_LAG_S, abs=0.3 * one.dt_s)


def test_a_delay_beyond_the_models_own_and_a_resonance_are_found():
    late = by_the_model(Explanation(replace(TRUE, delay_s=1.25), (), (), OFFSET_MPS), 2)
    search = search_of(late, longest_delay_s=0.5)
    base = search.fitted(START)
    assert base.explanation.core.delay_s <= 0.5
    found = search.grown(base.explanation, DelayCandidate())
    assert found.explanation.core.delay_s == pytest.approx(1.25, abs=0.05)
    assert "transport_delay" in found.explanation.names
    beside = search.grown(found.explanation, EffectCandidate("quadratic_gain"))
    assert beside.explanation.core.delay_s == pytest.approx(1.25, abs=0.06), "what was found stays"
    bare = search.fitted(without(found.explanation, "transport_delay"))
    assert bare.explanation.core.delay_s <= 0.5
    truth = replace(TRUE, resonance_share=0.5, resonance_hz=0.7, damping=0.15)
    search = search_of(by_the_model(Explanation(truth, (), (), OFFSET_MPS), 2))
    found = search.grown(search.fitted(START).explanation, ResonanceCandidate())
    core = found.explanation.core
    assert core.resonance_hz == pytest.approx(0.7, abs=0.03)
    assert core.resonance_share == pytest.approx(0.5, abs=0.07)
    assert core.damping == pytest.approx(0.15, abs=0.05)


def test_a_sensor_below_the_axis_about_which_a_body_swings_is_a_resonance_beside_the_drive():
    """The body is left behind, its lower end goes ahead: y = v - 0.6 z',  z'' = -v' - 2 d w z' - w^2 z."""
    one = drive(300.0, 3, 0.05, 0.0)
    omega, damping, swing_m, rate_mps, shown = 2.0 * np.pi * 0.85, 0.2, 0.0, 0.0, []
    for change_mps in np.diff(one.output, prepend=one.output[0]).tolist():
        for _ in range(5):  # of 10 ms
            rate_mps -= 0.2 * change_mps + 0.01 * (2.0 * damping * omega * rate_mps + omega**2 * swing_m)
            swing_m += 0.01 * rate_mps
        shown.append(-0.6 * rate_mps)
    noise = 0.01 * np.random.default_rng(2).standard_normal(len(one))
    swings = replace(one, columns={**one.columns, OUTPUT: one.output + np.array(shown) + noise})
    search = search_of(resample(swings, 0.2))
    base = search.fitted(START)
    found = search.grown(base.explanation, ResonanceCandidate())
    core = found.explanation.core
    assert core.resonance_share < -0.3
    assert core.resonance_hz == pytest.approx(0.85, abs=0.08)
    assert found.cost < 0.2 * base.cost


def test_no_number_leaves_its_bounds():
    """Hills that push and a current that never turns back: the load of a grade and the hysteresis end at nothing."""
    hills = wander(1200, 0.1, 7, 2.0, 5.0)
    one = drive(120.0, 4, 0.1, 0.02, load_mps=0.05 * hills, columns={"pitch_deg": hills})
    search = search_of(one, longest_delay_s=0.1)
    core = replace(START.core, delay_s=0.05)
    start = replace(START, core=core, effects=(Hysteresis(60.0, 0.9), Grade()), loads=(0.2,))
    plan = search.plan(start)
    tried = []

    class Spy(Scene):
        def errors(self, batch):
            tried.extend(batch)
            return super().errors(batch)

    found = fit(Spy([one], sorted(one.columns)), plan)
    assert len(tried) > 20
    for each in tried:
        owners = {"core": each.core, **{effect.name: effect for effect in each.effects}}
        given = {("offset", "offset_mps"): each.offset_mps, ("grade", "load"): each.loads[0]}
        for slot in plan.slots:
            key = slot.owner, slot.name
            value = given[key] if key in given else getattr(owners[slot.owner], slot.name)
            assert slot.low <= value <= slot.high, key
    assert found.explanation.core.delay_s == pytest.approx(0.1, abs=0.002)
    room = {slot.name: left for slot, left in zip(plan.slots, found.room.tolist(), strict=True)}
    assert room["delay_s"] == pytest.approx(0.1 - found.explanation.core.delay_s)
    assert room["lag_s"] == pytest.approx(found.explanation.core.lag_s - CORE["lag_s"].low)
    assert found.explanation.loads[0] == pytest.approx(0.0, abs=1e-3)
    (hysteresis, _) = found.explanation.effects
    assert isinstance(hysteresis, Hysteresis)
    assert hysteresis.width_ma * hysteresis.share == pytest.approx(0.0, abs=0.2)


def test_a_layout_and_its_vector_are_one_explanation():
    start = Explanation(
        replace(TRUE, resonance_share=0.2),
        (
            Hysteresis(30.0, 0.8),
            DeadZone(200.0, 10.0),
            QuadraticGain(0.3),
            Saturation(900.0, 5.0),
            Grade(0.5),
            CoulombFriction(0.3),
        ),
        (0.3, 0.2),
        0.15,
        frozenset({"resonance"}),
    )
    plan = layout(start, 1.0, GAIN, lambda name: not name.startswith("grade."))
    assert plan.explanation(plan.vector) == start
    assert {(slot.owner, slot.name) for slot in plan.slots if slot.owner == "grade"} == {("grade", "load")}
    assert len(plan.slots) == 5 + 3 + 1 + 2 + 3 + 2 + 2 + 1 + 2
    changed = plan.explanation(plan.vector + 1e-3 * plan.scale)
    assert replace(plan, start=changed).vector == pytest.approx(plan.vector + 1e-3 * plan.scale)
    assert changed.effects[4] == start.effects[4]
    bounds = {(slot.owner, slot.name): (slot.low, slot.high) for slot in plan.slots}
    assert bounds["grade", "load"] == (0.0, FAR)
    assert bounds["core", "delay_s"] == (0.0, 1.0)
    assert all(slot.scale > 0.0 and slot.low < slot.high for slot in plan.slots)


def test_no_fit_looks_for_shapes_that_change_nothing():
    def free(effect: PowerLimit) -> set[str]:
        plan = layout(Explanation(TRUE, (effect,)), 1.0, GAIN, lambda name: True)
        return {slot.name for slot in plan.slots if slot.owner == effect.name}

    by_load, by_bar = {"onset_pct", "cut_per_pct_s", "release_s"}, {"cutoff_bar", "cut_per_bar"}
    assert free(PowerLimit(power_kw=40.0)) == set(PowerLimit.parameters) - by_load - by_bar
    assert free(PowerLimit(onset_pct=90.0)) == by_load
    assert free(PowerLimit(cutoff_bar=300.0)) == by_bar
    assert free(PowerLimit(power_kw=40.0, onset_pct=90.0)) == set(PowerLimit.parameters) - by_bar


def test_the_derivatives_are_those_of_the_errors():
    search = search_of(by_the_model(SCATTERED, 1, 60.0))
    plan = search.plan(SCATTERED)
    objective = Objective(search.scene, plan)
    vector = plan.vector
    error, slopes = objective.differences(vector)
    judged = search.scene.judged
    assert np.all(error[~judged] == 0.0)
    names = [slot.name for slot in plan.slots]
    for name in ("gain_mps_per_ma", "time_constant_s", "offset_mps", "load", "threshold_ma"):
        i = names.index(name)
        step = np.zeros(len(vector))
        step[i] = 1e-3 * plan.scale[i]
        central = (objective.residual(vector + step) - objective.residual(vector - step)) / (2.0 * step[i])
        assert slopes[:, i] == pytest.approx(central, abs=5e-3 * np.max(np.abs(central)))


def test_the_solver_sees_a_triangle_with_all_sums_of_squares_and_products():
    search = search_of(by_the_model(SCATTERED, 1, 60.0))
    objective = Objective(search.scene, search.plan(SCATTERED))
    error, slopes = objective.differences(objective.plan.vector)
    triangle = objective.triangle(objective.plan.vector)
    whole = np.column_stack([slopes, error])
    assert triangle.shape == (whole.shape[1], whole.shape[1])
    np.testing.assert_allclose(triangle.T @ triangle, whole.T @ whole, rtol=1e-9, atol=1e-9)


def test_numbers_at_their_upper_bound_are_differentiated_inwards():
    search = search_of(by_the_model(SCATTERED, 1, 60.0), longest_delay_s=0.33)
    plan = search.plan(SCATTERED)
    _, slopes = Objective(search.scene, plan).differences(plan.vector)
    wider = search.plan(replace(SCATTERED, structural=frozenset({"transport_delay"})))
    assert (plan.slots[1].high, wider.slots[1].high) == (0.33, 2.0)
    _, same = Objective(search.scene, wider).differences(wider.vector)
    assert slopes[:, 1] == pytest.approx(same[:, 1], rel=0.02, abs=0.02 * np.max(np.abs(same[:, 1])))
    assert np.max(np.abs(slopes[:, 1])) > 0.1
