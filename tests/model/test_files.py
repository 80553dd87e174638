"""Model files: what is written reads back equal, and every mistake says where it is and what would be right."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.effects import EFFECTS, Custom, Stage
from cruise.effects.dead_zone import DeadZone
from cruise.model import files
from cruise.model.files import Provenance
from cruise.model.model import Model
from cruise.settings import SettingsError

FACTORY = Path(__file__).resolve().parents[2] / "config" / "factory_model.yaml"

finite = st.floats(-1e6, 1e6, allow_subnormal=False)


@st.composite
def effects(draw):
    """Any choice of effects, in any order, with any shapes within their bounds."""
    names = draw(st.lists(st.sampled_from(sorted(EFFECTS)), unique=True, max_size=8))
    return tuple(
        EFFECTS[name](**{key: draw(st.floats(one.low, one.high)) for key, one in EFFECTS[name].parameters.items()})
        for name in names
    )


@st.composite
def models(draw):
    na, nb = draw(st.integers(0, 10)), draw(st.integers(1, 10))
    chosen = draw(effects())
    size = na + nb + sum(effect.acts_as == "load" for effect in chosen) + 1
    row = st.lists(finite, min_size=size, max_size=size).map(tuple)
    return Model(
        period_s=draw(st.sampled_from([0.01, 0.05, 0.1, 0.2, 1.0 / 3.0, 1.0])),
        na=na,
        nb=nb,
        delay=draw(st.integers(0, 30)),
        effects=chosen,
        theta=draw(row),
        theta_std=draw(st.one_of(st.just(()), row.map(lambda values: tuple(abs(value) for value in values)))),
        residual_std_mps=draw(st.floats(1e-6, 1.0)),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("models")


@given(model=models())
def test_a_model_reads_back_equal(folder, model):
    files.save(folder / "m.yaml", model, Provenance(recordings=("a.csv",), samples=12, made_by="test"))
    assert files.load(folder / "m.yaml") == model


@pytest.mark.parametrize(("family", "noise"), [("arx", ()), ("armax", (0.6, -0.1)), ("oe", ())])
def test_how_it_was_found_and_what_it_is_worth_stand_in_the_file(folder, family, noise):
    model = Model(0.2, 1, 1, 3, (), (0.5, 1e-3, 0.0))
    provenance = Provenance(
        recordings=("a.csv, 0 to 60 s", "b.csv, 5 to 9 s"),
        samples=320,
        made_by="cruise identify --model oe6",
        made_on="2026-11-21",
        error_ahead_mps=0.0625,
        horizon_s=3.0,
        note="training data filtered at 1 Hz",
    )
    files.save(folder / "f.yaml", model, provenance, family, noise)
    file = files.read(folder / "f.yaml")
    assert (file.family, file.noise_parameters, file.provenance) == (family, noise, provenance)
    assert files.load(folder / "f.yaml") == model, "they all drive as ARX"


def test_a_file_from_before_there_were_families_is_arx(tmp_path):
    (tmp_path / "old.yaml").write_text(GOOD)
    file = files.read(tmp_path / "old.yaml")
    assert (file.family, file.noise_parameters, file.provenance.error_ahead_mps) == ("arx", (), None)


def test_the_delay_is_a_time_in_the_file(folder):
    model = Model(0.2, 1, 1, 3, (), (0.5, 1e-3, 0.0))
    files.save(folder / "t.yaml", model, Provenance())
    text = (folder / "t.yaml").read_text()
    assert "delay_s: 0.6\n" in text
    (folder / "t.yaml").write_text(text.replace("period_s: 0.2", "period_s: 0.05"))
    assert files.load(folder / "t.yaml").delay == 12


def test_the_factory_model_is_a_drive():
    model = files.load(FACTORY)
    assert abs(model.poles).max() < 1.0
    assert model.dc_gain_mps_per_ma > 0.0
    assert len(model.theta_std) == len(model.theta)


GOOD = """\
period_s: 0.2
na: 1
nb: 2
delay_s: 0.4
effects:
  dead_zone: {threshold_ma: 400.0}
  engine_speed: {exponent: 1.0}
parameters: {a_1: 0.5, b_0_mps_per_ma: 0.001, b_1_mps_per_ma: 0.001, c_0_mps: 0.0}
standard_errors: {a_1: 0.1, b_0_mps_per_ma: 0.1, b_1_mps_per_ma: 0.1, c_0_mps: 0.1}
residual_std_mps: 0.02
"""

MISTAKES = {
    "effect misspelt": ("dead_zone:", "dead_zon:", r"effects\.dead_zon: no such effect; did you mean dead_zone\?"),
    "effect unknown": (
        "dead_zone:",
        "flux_capacitor:",
        r"effects\.flux_capacitor: no such effect; known: .*gear_ratio",
    ),
    "shape unknown": ("threshold_ma:", "width_ma:", r"effects\.dead_zone: no parameter width_ma; known: threshold_ma"),
    "shape too large": ("400.0", "900.0", r"effects\.dead_zone\.threshold_ma: 900\.0 is outside 0\.0 to 800\.0 mA"),
    "shape too small": ("400.0", "-1.0", r"threshold_ma: -1\.0 is outside"),
    "shape not a number": ("400.0", ".nan", r":6: .*finite"),
    "key misspelt": ("delay_s:", "delays_s:", r":4: delays_s: .*delay_s"),
    "parameter missing": ("b_1_mps_per_ma: 0.001, c", "c", r"parameters: b_1_mps_per_ma missing.*needs a_1, b_0"),
    "parameter too many": ("{a_1: 0.5,", "{a_1: 0.5, a_2: 0.1,", r"parameters: a_2 missing or not of this structure"),
    "no parameters": (
        "{a_1: 0.5, b_0_mps_per_ma: 0.001, b_1_mps_per_ma: 0.001, c_0_mps: 0.0}",
        "{}",
        r"parameters: a_1, b_0_mps_per_ma, b_1_mps_per_ma, c_0_mps missing",
    ),
    "standard error missing": ("a_1: 0.1, ", "", r"standard_errors: a_1 missing"),
    "standard error negative": ("a_1: 0.1, ", "a_1: -0.1, ", r":9: standard_errors\.a_1.*0"),
    "delay between samples": ("delay_s: 0.4", "delay_s: 0.5", r"delay_s: 0\.5 is no multiple of period_s, 0\.2"),
    "delay negative": ("delay_s: 0.4", "delay_s: -0.4", r":4: delay_s"),
    "delay not a number": ("delay_s: 0.4", "delay_s: soon", r":4: delay_s"),
    "period of zero": ("period_s: 0.2", "period_s: 0.0", r":1: period_s"),
    "no input": ("nb: 2", "nb: 0", r":3: nb"),
    "order negative": ("na: 1", "na: -1", r":2: na"),
    "order beyond reason": ("na: 1", "na: 1000000000", r":2: na"),
    "family unknown": ("period_s: 0.2", "family: narx\nperiod_s: 0.2", r":1: family: .*'narx'"),
    "noise not a number": ("residual_std_mps: 0.02", "noise_parameters: [x]", r":10: noise_parameters"),
    "residual of nothing": ("residual_std_mps: 0.02", "residual_std_mps: 0.0", r":10: residual_std_mps"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_says_where_and_what(tmp_path, mistake):
    before, after, complaint = MISTAKES[mistake]
    assert GOOD.count(before) == 1
    path = tmp_path / "model.yaml"
    path.write_text(GOOD)
    files.load(path)
    path.write_text(GOOD.replace(before, after))
    with pytest.raises(SettingsError, match=complaint) as raised:
        files.load(path)
    assert str(path) in str(raised.value)


HEADER = Custom("header", Stage.GAIN, "1 + p1*(header_height_mm - 300)", (("p1", -0.01, 0.01),), p1=2e-3)
MUD = Custom("mud", Stage.LOAD, "-p1 * speed_mps", p1=-0.5)


def test_terms_of_ones_own_read_back_equal_and_at_their_places(folder):
    effects = (MUD, DeadZone(300.0), HEADER, Custom("bent", Stage.COMMAND, "value"))
    model = Model(0.2, 1, 1, 3, effects, (0.5, 1e-3, 0.2, 0.0))
    files.save(folder / "c.yaml", model, Provenance())
    assert files.load(folder / "c.yaml") == model


OWN = """\
custom: {name: header, stage: gain, expression: "1 + p1*(header_height_mm - 300)"}
"""
SEVERAL = """\
custom:
- {name: header, stage: gain, expression: "1 + p1*(header_height_mm - 300)", bounds: {p1: [-0.01, 0.01]}}
- {name: mud, stage: command, expression: "value * (1 - p1)"}
"""


def test_one_term_or_several_can_be_written_by_hand(tmp_path):
    (tmp_path / "one.yaml").write_text(GOOD + OWN)
    *_, header = files.load(tmp_path / "one.yaml").effects
    assert header == Custom("header", Stage.GAIN, "1 + p1*(header_height_mm - 300)")
    placed = GOOD.replace("  dead_zone", "  header: {p1: 0.005}\n  dead_zone")
    (tmp_path / "several.yaml").write_text(placed + SEVERAL)
    header, *_, mud = files.load(tmp_path / "several.yaml").effects
    assert isinstance(header, Custom)
    assert isinstance(mud, Custom)
    assert (header.name, header.p1, header.parameters["p1"].high) == ("header", 0.005, 0.01)
    assert (mud.name, mud.p1) == ("mud", 0.0)


OWN_MISTAKES = {
    "name taken": ("name: mud", "name: dead_zone", r"custom: name dead_zone: an effect has this name already"),
    "name twice": ("name: mud", "name: header", r"custom: name header: an effect has this name already"),
    "name no word": ("name: mud", 'name: "2nd"', r"custom\.2nd: name '2nd': use small letters"),
    "stage impossible": ("stage: command", "stage: sensor", r"custom\.mud: stage sensor: .* command, gain, load"),
    "stage unknown": ("stage: command", "stage: comand", r":14: custom\[1\]\.stage: .*comand.*did you mean command"),
    "reads the output": ("- 300)", "- ground_speed_mps)", r"custom\.header: ground_speed_mps is what is predicted"),
    "function misspelt": (
        "value * (1",
        "mix(value, 1) * (1",
        r"custom\.mud: column 1: no function mix; did you mean m",
    ),
    "formula unfinished": ("(1 - p1)", "(1 - p1", r"custom\.mud: column 9: not an expression"),
    "key misspelt": (
        'expression: "value',
        'expresion: "value',
        r":14: custom\[1\]\.expresion: .*did you mean expression",
    ),
    "bounds of nothing": ("{p1: [-0.01", "{p2: [-0.01", r"custom\.header: bounds of p2, which is no parameter"),
    "beyond its bounds": ("{p1: 0.005}", "{p1: 0.05}", r"effects\.header\.p1: 0\.05 is outside -0\.01 to 0\.01"),
    "parameter not in it": ("{p1: 0.005}", "{p2: 0.005}", r"effects\.header: no parameter p2; known: p1"),
}


@pytest.mark.parametrize("mistake", OWN_MISTAKES)
def test_a_mistake_in_a_term_of_ones_own_says_where_and_what(tmp_path, mistake):
    before, after, complaint = OWN_MISTAKES[mistake]
    text = GOOD.replace("  dead_zone", "  header: {p1: 0.005}\n  dead_zone") + SEVERAL
    assert text.count(before) == 1
    path = tmp_path / "model.yaml"
    path.write_text(text.replace(before, after))
    with pytest.raises(SettingsError, match=complaint) as raised:
        files.load(path)
    assert str(path) in str(raised.value)


def test_a_mistake_in_a_single_term_says_where_and_what(tmp_path):
    (tmp_path / "one.yaml").write_text(GOOD + OWN.replace("stage: gain", "stage: gian"))
    with pytest.raises(SettingsError, match=r":11: custom\.stage: .*did you mean gain\?"):
        files.load(tmp_path / "one.yaml")


def test_a_file_that_was_cut_off_anywhere_is_refused(tmp_path):
    """Its last lines are where it came from: without them all that drives is still there."""
    model = Model(0.2, 1, 1, 3, (DeadZone(400.0),), (0.5, 1e-3, 0.0))
    files.save(tmp_path / "whole.yaml", model, Provenance(recordings=("a.csv",), samples=12, note="two\nlines ..."))
    whole = (tmp_path / "whole.yaml").read_text()
    cut = tmp_path / "cut.yaml"
    for length in range(len(whole.rstrip())):
        cut.write_text(whole[:length])
        with pytest.raises(SettingsError, match=r"cut\.yaml:\d+: cut off" if length >= len("%YAML") else "cut"):
            files.load(cut)
    cut.write_text(whole.rstrip())
    assert files.load(cut) == model, "only the last line break is lost"


def test_what_is_written_by_hand_or_was_written_before_needs_no_end(tmp_path):
    model = Model(0.2, 1, 1, 3, (), (0.5, 1e-3, 0.0))
    files.save(tmp_path / "m.yaml", model, Provenance())
    first, start, *lines, end = (tmp_path / "m.yaml").read_text().splitlines()
    assert (first, start, end) == ("%YAML 1.2", "---", "...")
    for kept in ([*lines], [start, *lines], [*lines, end]):
        (tmp_path / "m.yaml").write_text("\n".join(kept))
        assert files.load(tmp_path / "m.yaml") == model


def test_no_such_file(tmp_path):
    with pytest.raises(SettingsError, match="no such file"):
        files.load(tmp_path / "nothing.yaml")


def test_a_model_that_is_not_a_number_is_not_written(tmp_path):
    path = tmp_path / "m.yaml"
    with pytest.raises(ValueError, match="finite"):
        files.save(path, Model(0.2, 0, 1, 0, (), (math.nan, 0.0)), Provenance())
    assert not path.exists()


def test_a_model_with_one_effect_twice_is_not_written_as_one_with_it_once(tmp_path):
    zone = DeadZone(threshold_ma=100.0)
    with pytest.raises(ValueError, match="dead_zone"):
        files.save(tmp_path / "m.yaml", Model(0.2, 0, 1, 0, (zone, zone), (1e-3, 0.0)), Provenance())
