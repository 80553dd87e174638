"""What could be missing: who is refused and why, the order of the chain, what goes in comes out again."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.effects import EFFECTS, Stage
from cruise.effects.coulomb_friction import CoulombFriction
from cruise.effects.dead_zone import DeadZone
from cruise.effects.engine_speed import EngineSpeed
from cruise.effects.gear_ratio import GearRatio
from cruise.effects.grade import Grade
from cruise.effects.hysteresis import Hysteresis
from cruise.effects.leakage import Leakage
from cruise.effects.power_limit import NEVER_PCT, UNLIMITED_KW, PowerLimit
from cruise.effects.rate_limit import RateLimit
from cruise.effects.saturation import Saturation
from cruise.signals import INPUT, OUTPUT
from cruise.validation import study
from cruise.validation.beginnings import AT_ONCE_S, BAR_CUTS, CUT_OFFS, RATES
from cruise.validation.candidates import (
    BLIND,
    CONSEQUENCES,
    DelayCandidate,
    EffectCandidate,
    Refused,
    ResonanceCandidate,
    candidate_of,
    candidates,
    owner,
    unnamed,
    ways_of,
    why_not,
    with_effect,
    without,
)
from cruise.validation.explanation import CORE, RESONANCE
from cruise.validation.unnamed import POWERS, PUSHES, SPEED, UnnamedGain
from tests.validation.driving import wander
from tests.validation.recorded import BARE, SAMPLES, everything, recorded
from tools.trial.run import table_without

# -- refusals


def test_what_is_not_recorded_can_not_be_blamed():
    found, refused = candidates([recorded()], BARE)
    reasons = {one.effect: one.reason for one in refused}
    assert reasons["grade"] == "pitch_deg is not recorded"
    assert reasons["engine_speed"] == "engine_speed_rpm is not recorded"
    assert reasons["gear_ratio"] == "gear is not recorded"
    assert {one.name for one in found} | set(reasons) == set(EFFECTS)
    assert not {one.name for one in found} & set(reasons)
    free = {name for name, kind in EFFECTS.items() if not set(kind.needs) - {OUTPUT}}
    assert {one.name for one in found} == free


DROOP_SHOWS = Refused("engine_droop", "engine_speed_rpm is recorded, and shows all that it does")


def test_with_every_signal_nothing_is_refused_but_what_stands_for_a_signal():
    found, refused = candidates([everything()], BARE)
    assert refused == [DROOP_SHOWS]
    assert [one.name for one in found] == [name for name in EFFECTS if name != "engine_droop"]


def test_droop_may_be_missing_where_the_engines_speed_is_not_known_everywhere():
    known, other = everything(1), everything(2)
    unknown = replace(other, columns={**other.columns, "engine_speed_rpm": np.full(SAMPLES, np.nan)})
    for recordings in ([unknown], [known, unknown]):
        assert "engine_droop" in {one.name for one in candidates(recordings, BARE)[0]}
    assert study.candidate("engine_droop", [known]).name == "engine_droop"  # whoever asks for it by name gets it


def test_droop_that_the_engines_speed_does_not_show_may_be_missing_beside_that():
    found, refused = candidates([everything()], with_effect(BARE, EngineSpeed()))
    assert refused == []
    assert "engine_droop" in {one.name for one in found}


def test_what_never_moves_is_not_excited_not_absent():
    still = recorded(engine_speed_rpm=2050.0 + wander(SAMPLES, 0.2, 1, 5.0, 4.0), pitch_deg=np.zeros(SAMPLES))
    assert (
        why_not(EngineSpeed, [still])
        == f"engine_speed_rpm never moves: it stays at {np.median(still.columns['engine_speed_rpm']):g} rpm"
    )
    assert why_not(Grade, [still]) == "pitch_deg never moves: it stays at 0 deg"
    geared = recorded(gear=np.full(SAMPLES, 2.0))
    assert why_not(GearRatio, [geared]) == "gear never moves: it stays at 2", "a gear has no unit"
    _, refused = candidates([still], BARE)
    assert Refused("grade", "pitch_deg never moves: it stays at 0 deg", still=True) in refused
    moving = recorded(engine_speed_rpm=2050.0 + wander(SAMPLES, 0.2, 1, 40.0, 4.0))
    assert why_not(EngineSpeed, [moving]) == ""


def test_a_signal_that_moves_between_recordings_moves():
    low, high = (recorded(seed, engine_speed_rpm=np.full(SAMPLES, rpm)) for seed, rpm in ((1, 1800.0), (2, 2100.0)))
    assert "never moves" in why_not(EngineSpeed, [low])
    assert why_not(EngineSpeed, [low, high]) == ""
    assert why_not(EngineSpeed, [low, recorded(3)]) == "engine_speed_rpm is not recorded"


def test_holes_and_single_spikes_are_no_movement():
    rpm = np.full(SAMPLES, 2000.0)
    rpm[10:60] = np.nan
    rpm[100] = 2900.0
    assert (
        why_not(EngineSpeed, [recorded(engine_speed_rpm=rpm)]) == "engine_speed_rpm hardly moves: it stays at 2000 rpm"
    )
    nothing = recorded(engine_speed_rpm=np.full(SAMPLES, np.nan))
    assert why_not(EngineSpeed, [nothing]) == "engine_speed_rpm is not recorded"


def test_what_is_explained_already_is_no_candidate():
    explanation = replace(with_effect(BARE, DeadZone(200.0)), structural=frozenset({"resonance"}))
    found, refused = candidates([everything()], explanation)
    assert {one.name for one in found} == set(EFFECTS) - {"dead_zone", "resonance", "engine_droop"}
    assert refused == [DROOP_SHOWS]


# -- credit


def test_consequences_of_the_drive_get_less_credit_than_causes():
    found = {one.name: one for one in candidates([everything()], BARE)[0]}
    assert found["crop_load"].credit == CONSEQUENCES["engine_load_pct"] < 1.0
    for name in (
        "grade",
        "dead_zone",
        "engine_speed",
        "coulomb_friction",
        "transport_delay",
        "resonance",
        "gear_ratio",
    ):
        assert found[name].credit == 1.0
    curves = {one.signal: one.credit for one in unnamed([everything()], BARE)}
    assert curves["line_pressure_bar"] == BLIND["line_pressure_bar"] < 1.0
    assert curves["engine_load_pct"] == BLIND["engine_load_pct"] < 1.0
    assert curves["slope_deg"] == curves[INPUT] == curves[SPEED] == 1.0


def test_the_sensor_itself_tells_how_much_acceleration_it_shows():
    one = recorded(pitch_deg=wander(SAMPLES, 0.2, 1, 2.0, 4.0))
    accel = np.gradient(one.output, 0.2)
    tilted = recorded(pitch_deg=one.columns["pitch_deg"] + np.degrees(np.arcsin(np.clip(accel / 9.81, -1.0, 1.0))))
    for each, low, high in ((one, 0.0, 0.15), (tilted, 0.75, 1.0)):
        (grade,) = [candidate for candidate in candidates([each], BARE)[0] if candidate.name == "grade"]
        for grown in grade.grown(BARE):
            (effect,) = grown.effects
            assert isinstance(effect, Grade)
            assert low <= effect.acceleration_share <= high


# -- starts


@pytest.mark.parametrize("name", EFFECTS)
def test_every_start_of_an_effect_lies_in_its_bounds_away_from_neutral(name):
    candidate = candidate_of(name, [everything()])
    starts = list(candidate.grown(BARE))
    assert starts
    for start in starts:
        assert name in start.names
        for effect in start.effects:
            for key, bound in effect.parameters.items():
                assert bound.low <= getattr(effect, key) <= bound.high
        assert all(load == 0.0 for load in start.loads)
        assert len(start.loads) == len(start.at(Stage.LOAD))
    if name in ("dead_zone", "saturation", "hysteresis", "quadratic_gain"):
        others = {"edge_ma", "knee_ma", "bend", "share", "jump_share", "release_share", *EFFECTS[name].spare}
        (shape,) = EFFECTS[name].parameters.keys() - others
        values = [getattr(start.effects[0], shape) for start in starts]
        neutral = EFFECTS[name].parameters[shape].neutral
        assert abs(values[0] - neutral) < abs(values[1] - neutral)
        assert values[0] != neutral


def test_a_rate_limit_takes_the_servos_lag_over():
    for start in EffectCandidate("rate_limit").grown(BARE):
        (effect,) = start.effects
        assert isinstance(effect, RateLimit)
        assert effect.lag_s == BARE.core.lag_s
        assert start.core.lag_s == CORE["lag_s"].low


def test_a_power_limit_may_go_by_power_engine_load_or_pressure_each_with_its_own_starts():
    pitch, load = wander(SAMPLES, 0.2, 3, 20.0, 3.0), 60.0 + wander(SAMPLES, 0.2, 4, 20.0, 20.0)
    bar = 200.0 + wander(SAMPLES, 0.2, 5, 20.0, 60.0)
    signals = {"pitch_deg": pitch, "engine_load_pct": load}
    by_power, by_load = ways_of(candidate_of("power_limit", [recorded(**signals)]))
    core = BARE.core
    behind_s = pytest.approx(core.delay_s + core.lag_s + core.second_lag_s + core.time_constant_s)
    follows = []
    for one in (start.effects[0] for start in by_power.grown(BARE)):
        assert isinstance(one, PowerLimit)
        follows.append((one.hold == 1.0, one.follow_s))
        assert one.power_kw < UNLIMITED_KW
        assert one.onset_pct == NEVER_PCT
        assert one.idle == {"onset_pct", "cut_per_pct_s", "release_s", "cutoff_bar", "cut_per_bar"}
    assert (False, AT_ONCE_S) in follows
    assert (True, behind_s) in follows
    assert all(one in [(False, AT_ONCE_S), (True, behind_s), (True, AT_ONCE_S)] for one in follows)
    for one in (start.effects[0] for start in by_load.grown(BARE)):
        assert isinstance(one, PowerLimit)
        assert one.power_kw == UNLIMITED_KW
        assert one.onset_pct < 100.0
        assert {"power_kw", "hold", "follow_s", "filter_s", "cutoff_bar"} <= one.idle
        assert "onset_pct" not in one.idle
    *_, by_bar = ways_of(candidate_of("power_limit", [recorded(**signals, line_pressure_bar=bar)]))
    shapes = [one for start in by_bar.grown(BARE) for one in start.effects if isinstance(one, PowerLimit)]
    assert len(set(shapes)) == len(shapes) == len(CUT_OFFS) * len(BAR_CUTS)  # what is told does not matter here
    assert all(one.idle.isdisjoint({"cutoff_bar", "cut_per_bar"}) for one in shapes)
    assert all(bar.min() < one.cutoff_bar < bar.max() for one in shapes)
    (alone,) = ways_of(candidate_of("power_limit", [recorded(pitch_deg=pitch)]))
    assert list(alone.grown(BARE)) == list(by_power.grown(BARE))


HAVE_SPARE = [name for name, kind in EFFECTS.items() if kind.spare and name != "oil_temperature"]  # its goes with drag


@pytest.mark.parametrize("name", HAVE_SPARE)
def test_a_spare_shape_is_neutral_where_fits_start_and_none_looks_for_it(name):
    starts = [one.effects[0] for one in candidate_of(name, [everything()]).grown(BARE)]
    assert starts
    spare, *_ = starts[0].spare
    assert all(set(one.spare) <= one.idle for one in starts)
    bound = starts[0].parameters[spare]
    assert spare not in starts[0].reshaped(**{spare: 0.5 * (bound.low + bound.high) + 0.1}).idle


def test_a_machine_may_brake_at_another_pace_or_no_faster_than_at_a_rate():
    candidate = candidate_of("active_braking", [recorded()])
    paced, falling = (list(way.grown(BARE)) for way in ways_of(candidate))
    assert all("fall_ma_per_s" in one.effects[0].idle for one in paced)
    assert all("fall_ma_per_s" not in one.effects[0].idle for one in falling)
    assert len({one.effects[0] for one in falling}) == len(falling) == len(RATES)
    assert [*paced, *falling] == list(candidate.grown(BARE))


def test_a_rate_limit_starts_where_it_limits_something():
    changes = np.abs(np.diff(recorded().input)) / 0.2
    limits = [one.effects[0] for one in candidate_of("rate_limit", [recorded()]).grown(BARE)]
    rates = [one.rate_ma_per_s for one in limits if isinstance(one, RateLimit)]
    assert len(rates) == len(limits) == len(RATES)
    assert all(20.0 < rate < changes.max() for rate in rates)
    assert rates == sorted(rates, reverse=True)


@pytest.mark.parametrize("name", [name for name, kind in EFFECTS.items() if not kind.needs])
def test_an_effect_begins_alike_though_the_table_knows_no_other(name):
    begun = list(candidate_of(name, [recorded()]).grown(BARE))
    with table_without([other for other in EFFECTS if other != name]):
        assert list(candidate_of(name, [recorded()]).grown(BARE)) == begun


def test_an_effect_that_was_fitted_starts_where_it_was():
    (start,) = EffectCandidate("dead_zone", given=DeadZone(234.5)).grown(BARE)
    assert start.effects == (DeadZone(234.5),)


def test_structure_starts_from_more_delay_and_from_four_frequencies():
    delays = [one.core.delay_s for one in DelayCandidate().grown(BARE)]
    assert delays == pytest.approx([0.3, 0.8])
    late = replace(BARE, core=replace(BARE.core, delay_s=1.9))
    assert [one.core.delay_s for one in DelayCandidate().grown(late)][1] == CORE["delay_s"].high
    assert all("transport_delay" in one.structural for one in DelayCandidate().grown(BARE))
    starts = list(ResonanceCandidate().grown(BARE))
    assert len({one.core.resonance_hz for one in starts}) == 4
    for one in starts:
        assert one.structural == {"resonance"}
        assert all(RESONANCE[name].low < getattr(one.core, name) < RESONANCE[name].high for name in RESONANCE)


# -- in and out


CHAIN = (Saturation(800.0), Hysteresis(40.0), Leakage(), DeadZone(200.0), RateLimit(500.0), Grade(), CoulombFriction())


def test_effects_stand_in_the_order_in_which_the_current_meets_them():
    explanation = BARE
    for effect in CHAIN:
        explanation = with_effect(explanation, effect)
    order = ("rate_limit", "hysteresis", "dead_zone", "saturation", "grade", "coulomb_friction", "leakage")
    assert explanation.names == order
    backwards = BARE
    for effect in reversed(CHAIN):
        backwards = with_effect(backwards, effect)
    assert backwards == explanation
    gained = with_effect(explanation, UnnamedGain("header", 0.0, 1.0))
    assert gained.names == (*order, "header:gain")


def test_loads_stay_with_their_effects():
    explanation = replace(with_effect(with_effect(BARE, Leakage()), CoulombFriction()), loads=(0.3, 0.7))
    assert explanation.names == ("coulomb_friction", "leakage")
    grown = with_effect(explanation, Grade())
    assert grown.names == ("grade", "coulomb_friction", "leakage")
    assert grown.loads == (0.0, 0.3, 0.7)
    assert without(grown, "coulomb_friction").loads == (0.0, 0.7)
    assert without(grown, "dead_zone") == grown


@pytest.mark.parametrize("name", EFFECTS)
def test_without_undoes_what_a_candidate_did(name):
    present = replace(with_effect(with_effect(BARE, Hysteresis(30.0)), Leakage()), loads=(0.4,))
    candidate = candidate_of(name, [everything()])
    if name in present.names:
        assert without(present, name).names == tuple(one for one in present.names if one != name)
        return
    for grown in candidate.grown(present):
        assert name in grown.names
        bare = without(grown, name)
        assert bare.names == present.names
        assert bare.effects == present.effects
        assert bare.loads == present.loads
        assert bare.core.resonance_share == 0.0
        assert bare.offset_mps == present.offset_mps


def test_an_unnamed_dependence_goes_as_a_whole():
    present = replace(with_effect(with_effect(BARE, Hysteresis(30.0)), Leakage()), loads=(0.4,))
    for candidate in unnamed([everything()], present):
        (grown,) = candidate.grown(present)
        parts = [effect for effect in grown.effects if effect not in present.effects]
        assert {owner(effect) for effect in parts} == {candidate.name}
        whole = 1 + len(POWERS) + len(PUSHES)
        several = {INPUT: 2, SPEED: 1 + len(POWERS)}
        assert len(parts) == several.get(candidate.signal, whole)
        assert without(grown, candidate.name) == present
    assert owner(DeadZone()) == "dead_zone"
