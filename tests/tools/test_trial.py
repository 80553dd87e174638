"""tools/trial: each effect is felt and nothing else is, the base machine is linear, and the answers stay sealed."""

import ast
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter
from typer.testing import CliRunner

from tools.trial import (
    EFFECTS,
    UNLISTED,
    Present,
    Tier,
    Trial,
    course,
    draw,
    effects,
    experiment,
    files,
    machine,
    simulate,
)
from tools.trial.__main__ import app
from tools.trial.draw import mixture
from tools.trial.trial import NOISE_MPS, PERIOD_S, SECONDS

simulators = sys.modules["tools.trial.simulate"]
ROOT = Path(__file__).parents[2]
GENERATOR = ("trial", "course", "machine", "effects", "simulate", "draw", "files")
SPEED = "ground_speed_mps"


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings of 30 s instead of 15 minutes."""
    for tier in SECONDS:
        monkeypatch.setitem(SECONDS, tier, 30.0)


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def one(effect: str, size: float, seed: int = 3, tier: Tier = "clean") -> Trial:
    present = (Present(effect=effect, size=size),)
    if effect in EFFECTS:
        return Trial(tier=tier, seed=seed, effects=present)
    return Trial(tier=tier, seed=seed, unlisted=present)


def linear_rms_mps(columns) -> float:
    """Free-run error [m/s] of the best dead time, two lags and gain, fitted in simulation (Söderström, Stoica 1989)."""
    current, speed = columns["pump_current_ma"], columns[SPEED]
    count = len(speed)

    def lag(values, lag_s):
        keep = np.exp(-PERIOD_S / lag_s)
        return lfilter([1.0 - keep], [1.0, -keep], values)

    def residual(shape):
        delay_s, *lags_s = shape
        past = np.arange(count) - delay_s / PERIOD_S
        held = lag(np.interp(past, np.arange(count), current, left=0.0), lags_s[0])
        # The second lag is fed by what moves within a period: by the mean of its two ends.
        late = lag(0.5 * (held + np.concatenate(([0.0], held[:-1]))), lags_s[1])
        columns = np.column_stack((late, np.ones(count)))
        return speed - columns @ np.linalg.lstsq(columns, speed)[0]

    fits = [
        least_squares(residual, (d, 0.3, 0.4), diff_step=1e-3, bounds=((0, 0.02, 0.02), (2, 3, 3))) for d in (0.2, 0.5)
    ]
    return min(rms(fit.fun) for fit in fits)


def test_the_base_machine_is_dead_time_lags_and_inertia(monkeypatch):
    monkeypatch.setitem(SECONDS, "clean", 200.0)
    found = linear_rms_mps(simulate(draw("clean", "nothing", "medium", 1)))
    assert found == pytest.approx(NOISE_MPS["clean"], rel=0.05)


@pytest.mark.parametrize("effect", [*EFFECTS, *UNLISTED])
def test_an_effect_is_felt_and_the_more_the_larger(effect, monkeypatch):
    if effect in ("gear_ratio", "sensor_bias", "power_limit", "saturation", "rate_limit", "tyre_pressure"):
        monkeypatch.setitem(SECONDS, "clean", 90.0)  # what drives them comes rarely
    row = (EFFECTS | UNLISTED)[effect]
    large = one(effect, row.large[1])
    # Equal noise: what is left between two of a seed is the effect alone.
    none, some, much = (
        simulate(trial)[SPEED] for trial in (large.resized(effect, 0.0), large.resized(effect, row.medium[1]), large)
    )
    assert rms(much - none) > NOISE_MPS["clean"]
    assert rms(much - none) > 1.2 * rms(some - none) > 0.0


@pytest.mark.parametrize("tier", ["clean", "field"])
def test_every_context_signal_moves_without_being_felt(tier: Tier, monkeypatch):
    monkeypatch.setitem(SECONDS, tier, 120.0)
    trial = Trial(tier=tier, seed=5)
    shown = simulate(trial)
    least = {
        "engine_speed_rpm": 20.0,
        "pitch_deg": 0.5,
        "machine_mass_kg": 100.0,
        "oil_temperature_c": 0.5,
        "engine_load_pct": 3.0,
        "line_pressure_bar": 5.0,
        "header_height_mm": 20.0,
        "tyre_pressure_bar": 0.03,
    }
    assert {name: float(np.std(shown[name])) for name in least if np.std(shown[name]) < least[name]} == {}
    drawn = course.draw

    def another(trial):
        now, other = drawn(trial), drawn(Trial(tier=trial.tier, seed=99))
        felt = ("time_s", "current_ma", "soil")
        return replace(other, **{name: getattr(now, name) for name in felt})

    monkeypatch.setattr(course, "draw", another)
    with_other_context = simulate(trial)
    assert rms(with_other_context["pitch_deg"] - shown["pitch_deg"]) > 0.5
    np.testing.assert_allclose(with_other_context[SPEED], shown[SPEED], atol=2e-3)


def test_a_trial_is_the_same_again_and_another_seed_another():
    trial = draw("clean", "grade", "large", 7)
    again = simulate(trial)
    for name, values in simulate(trial).items():
        np.testing.assert_array_equal(values, again[name])
    other = simulate(draw("clean", "grade", "large", 8))
    assert rms(other["pump_current_ma"] - again["pump_current_ma"]) > 50.0


def test_another_size_is_the_same_drive():
    trial = draw("clean", "dead_zone+crop_load", "medium", 4)
    larger = trial.resized("crop_load", 200.0)
    assert [present.effect for present in larger.effects] == ["dead_zone", "crop_load"]
    assert larger.effects[0] == trial.effects[0]
    before, after = simulate(trial), simulate(larger)
    for name in ("time_s", "pump_current_ma", "gear", "machine_mass_kg", "oil_temperature_c"):
        np.testing.assert_array_equal(before[name], after[name])
    assert trial.without("crop_load").effects == trial.effects[:1]
    assert trial.without() == Trial(tier="clean", seed=4)


@pytest.mark.parametrize(
    ("ask", "complaint"),
    [
        (lambda: draw("clean", "magic", "large", 1), "no effect magic"),
        (lambda: draw("clean", "grade", "huge", 1), "no size huge"),
        (lambda: draw("clean", "engine_speed+engine_droop", "large", 1), "can't be told apart"),
        (lambda: draw("clean", "grade", "large", 1).resized("leakage", 1.0), "leakage is not in this trial"),
        (lambda: draw("clean", "grade", "large", 1).resized("grade", -1.0), "impossible"),
        (lambda: draw("clean", "grade", "large", 1).resized("grade", float("nan")), "impossible"),
    ],
)
def test_what_there_is_not_is_refused(ask, complaint):
    with pytest.raises(ValueError, match=complaint):
        ask()


def test_drawn_sizes_lie_in_their_range_and_rise():
    for name, row in (EFFECTS | UNLISTED).items():
        assert 0.0 < row.small[0] < row.small[1] <= row.medium[0] < row.medium[1] <= row.large[0] < row.large[1], name
    for size in ("small", "medium", "large"):
        low, high = getattr(EFFECTS["grade"], size)
        sizes = [draw("clean", "grade", size, seed).effects[0].size for seed in range(20)]
        assert low <= min(sizes) < max(sizes) <= high


def test_a_clean_drive_excites_and_a_field_drive_is_an_operators(monkeypatch):
    for tier in SECONDS:
        monkeypatch.setitem(SECONDS, tier, 600.0)
    clean, field = course.draw(Trial(tier="clean", seed=2)), course.draw(Trial(tier="field", seed=2))
    per_sample_ma = [np.abs(np.diff(driven.current_ma)) for driven in (clean, field)]
    assert np.mean(per_sample_ma[0]) > 20.0
    assert np.max(per_sample_ma[1]) < 80.0, "a lever is not thrown"
    assert np.corrcoef(field.grain_kg, field.oil_c)[0, 1] > 0.8 > np.corrcoef(clean.grain_kg, clean.oil_c)[0, 1]
    changes = np.flatnonzero(np.diff(field.gear))
    assert len(changes) > 0
    assert np.all(np.abs(field.current_ma[changes]) < 60.0), "gears are changed at a stop"


def test_the_field_has_a_little_of_everything_behind(monkeypatch):
    monkeypatch.setitem(SECONDS, "field", 600.0)
    trial = draw("field", "nothing", "medium", 6)
    assert 0.05 <= trial.background <= 0.1
    assert draw("clean", "nothing", "medium", 6).background == 0.0
    driven, felt = machine.base(trial, course.draw(trial)), course.draw(trial)
    effects.make(driven, felt, trial)
    assert driven.settings.pump.threshold_ma > 0.0
    assert 0.0 < np.std(driven.felt_grade_deg) < 0.2 * np.std(driven.shown_grade_deg)
    assert np.corrcoef(driven.rolling_resistance, felt.soil)[0, 1] > 0.9
    assert 0.0 < np.std(driven.felt_rpm) < 0.2 * np.std(driven.shown_rpm)


def test_a_mixture_holds_every_kind():
    trials = mixture("clean", 200, 1)
    counts = {(len(trial.effects), len(trial.unlisted)) for trial in trials}
    assert counts == {(0, 0), (1, 0), (0, 1), (2, 0), (3, 0)}
    assert {present.effect for trial in trials for present in trial.effects} == set(EFFECTS)
    assert len({trial.seed for trial in trials}) == 200
    assert mixture("clean", 3, 1) == trials[:3]


def test_recordings_and_answers_are_files_of_their_own(tmp_path):
    said = CliRunner().invoke(app, ["make", "--out", str(tmp_path / "a"), "--count", "2", "--effect", "grade"])
    assert said.exit_code == 0, said.output
    sealed = files.answers(tmp_path / "a")
    assert [answer.recording for answer in sealed] == ["0000.csv", "0001.csv"]
    assert [present.effect for answer in sealed for present in answer.trial.effects] == ["grade", "grade"]
    text = (tmp_path / "a" / "0001.csv").read_text(encoding="utf-8")
    assert "grade" not in text
    values = np.loadtxt(text.splitlines(), delimiter=",", skiprows=1)
    columns = simulate(sealed[1].trial)
    assert text.splitlines()[0].split(",") == list(columns)
    np.testing.assert_allclose(values[:, list(columns).index(SPEED)], columns[SPEED], atol=1e-4)


def test_a_folder_in_use_is_left_alone(tmp_path):
    (tmp_path / "mine.csv").write_text("x", encoding="utf-8")
    said = CliRunner().invoke(app, ["make", "--out", str(tmp_path), "--count", "1"])
    assert said.exit_code == 2
    assert "holds files" in " ".join(said.output.replace("│", " ").split())  # a box is drawn around the words
    assert [path.name for path in tmp_path.iterdir()] == ["mine.csv"]


@pytest.mark.parametrize("name", GENERATOR)
def test_the_generator_shares_no_code_with_what_it_tests(name):
    tree = ast.parse((ROOT / "tools" / "trial" / f"{name}.py").read_text(encoding="utf-8"))
    modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    modules += [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    assert [module for module in modules if module.startswith("cruise") and not module.startswith("cruise.plant")] == []


def test_every_effect_has_an_experiment():
    assert set(EFFECTS) <= set(experiment.experiments())


@pytest.mark.parametrize("effect", EFFECTS)
def test_the_experiment_of_an_effect_shows_it(effect):
    """The machine of the recording, with other noise; what the effect does there is far above the noise."""
    row = EFFECTS[effect]
    trial = one(effect, effects.ranges(row, "large", "field")[1], tier="field")
    driven = experiment.course_of(effect, trial)
    shown = simulate(trial, driven)
    assert len(shown["time_s"]) == len(driven.time_s) > 60.0 / PERIOD_S
    without = simulate(trial.without(effect), driven)
    moved = shown[SPEED] - without[SPEED]
    assert rms(moved) > 1e-3
    assert shown.keys() >= simulate(trial).keys() - {"time_s"}


def test_an_experiment_is_driven_with_the_machine_of_the_recording():
    """A power that is in relation to what the recording asks for stays, though the experiment asks for more."""
    trial = one("power_limit", 1.0)
    steep = experiment.course_of("power_limit", trial)
    limited = simulate(trial, steep)[SPEED]
    of_its_own = simulators.made(trial, steep).settings.pump.power_kw
    assert of_its_own > 1.5 * simulators.made(trial, course.draw(trial)).settings.pump.power_kw
    assert rms(limited - simulate(trial.without("power_limit"), steep)[SPEED]) > 0.1


def test_values_are_reached_and_held():
    trial = one("dead_zone", 20.0)
    driven = experiment.course_of("rolling_resistance", trial)
    assert driven.grain_kg[-1] == pytest.approx(0.95 * course.GRAIN_KG)
    assert driven.current_ma.min() == pytest.approx(-500.0)
    hill = experiment.course_of("grade", trial)
    assert (hill.grade_deg.min(), hill.grade_deg.max()) == pytest.approx((-4.0, 4.0))
    gears = experiment.course_of("gear_ratio", trial)
    assert list(dict.fromkeys(gears.gear.tolist())) == [2, 1, 3]
    sweep = experiment.course_of("resonance", trial).current_ma
    assert 440.0 < sweep[round(12.0 / PERIOD_S) : round(72.0 / PERIOD_S)].max() <= 450.0
