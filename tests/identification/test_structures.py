"""Structures: the paper's by name, any other written out, and what is wrong said with what would be right."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.effects import EFFECTS
from cruise.identification.regressors import FitError
from cruise.identification.structures import PRESETS, Family, Structure, parse

# Tables I to IV of the paper: na (nf for oe), nb, delay in s
ARX = {
    "arx1": (10, 10, 0.0),
    "arx2": (0, 10, 0.0),
    "arx3": (10, 0, 0.0),
    "arx4": (0, 10, 0.5),
    "arx5": (0, 5, 0.5),
    "arx6": (0, 4, 0.5),
    "arx7": (0, 3, 0.5),
    "arx8": (0, 2, 0.5),
    "arx9": (0, 3, 0.0),
    "arx10": (1, 3, 0.5),
    "arx7B": (0, 3, 0.5),
    "arx10B": (1, 3, 0.5),
}
OUTPUT_ERROR = {
    "oe1": (5, 5, 0.0),
    "oe2": (5, 1, 0.0),
    "oe3": (0, 5, 0.0),
    "oe4": (0, 5, 0.5),
    "oe5": (0, 4, 0.5),
    "oe6": (0, 3, 0.5),
    "oe7": (0, 2, 0.5),
    "oe8": (0, 3, 0.0),
}
OTHERS = {"armax": (0, 3, 0.5), "narx1": (2, 3, 0.0), "narx2": (2, 3, 0.0)}


def test_the_names_mean_what_the_paper_prints():
    expected = ARX | OUTPUT_ERROR | OTHERS
    assert {name: (one.na, one.nb, one.delay_s) for name, one in PRESETS.items()} == expected
    assert all(PRESETS[name].family is Family.ARX for name in ARX)
    assert all(PRESETS[name].family is Family.OUTPUT_ERROR for name in OUTPUT_ERROR)
    assert [PRESETS[name].degree for name in ("narx1", "narx2")] == [2, 3]
    assert PRESETS["armax"].nc == 1
    curved = {name for name, one in PRESETS.items() if one.effects}
    assert curved == {"arx7B", "arx10B"}
    assert PRESETS["arx10B"].effects == ("saturation", "dead_zone", "quadratic_gain")
    assert all(parse(name).name == name for name in PRESETS)


@st.composite
def structures(draw):
    """Any structure that can be written."""
    family = draw(st.sampled_from(Family))
    na, nb = draw(st.integers(0, 100)), draw(st.integers(0, 100))
    if na + nb == 0:
        nb = 1
    return Structure(
        family,
        na,
        nb,
        draw(st.integers(0, 6000)) / 100.0,
        draw(st.integers(0, 9)) if family is Family.ARMAX else 0,
        draw(st.integers(0, 6)) if family is Family.NARX else 0,
        tuple(draw(st.lists(st.sampled_from(sorted(EFFECTS)), unique=True))),
    )


@given(structure=structures())
def test_what_is_written_is_read_back(structure):
    assert parse(str(structure)) == structure


def test_a_preset_takes_further_effects_and_then_has_no_name():
    assert parse("arx10B+gear_ratio") == Structure(
        Family.ARX, 1, 3, 0.5, effects=("saturation", "dead_zone", "quadratic_gain", "gear_ratio")
    )
    assert parse(" arx10 ") == PRESETS["arx10"]


MISTAKES = {
    "arx11": r"no such name; did you mean arx1.*arx10B.*a model file, or a structure such as arx:na=1",
    "arx10b": r"did you mean arx10B\?",
    "box_jenkins:na=1": r"no such name; known: ",
    "": r"no such name",
    "arx": r"na, nb, delay_s missing; arx takes na, nb, delay_s",
    "arx:na=1,nb=3": r"delay_s missing",
    "oe:na=1,nb=3,delay_s=0": r"'na=1' is no order of oe; it takes nf, nb, delay_s",
    "arx:na=1,nb=3,nc=1,delay_s=0": r"'nc=1' is no order of arx",
    "armax:na=1,nb=3,delay_s=0": r"nc missing",
    "narx:na=1,nb=3,delay_s=0,degree=7": r"degree=7 is outside 0 to 6",
    "arx:na=1,nb,delay_s=0": r"'nb' is no order of arx",
    "arx:na=1.5,nb=3,delay_s=0": r"na=1\.5 is no whole number",
    "arx:na=1,nb=3,delay_s=soon": r"delay_s=soon is no time in s",
    "arx:na=1,nb=3,delay_s=nan": r"delay_s=nan is outside 0 to 60",
    "arx:na=1,nb=3,delay_s=61": r"outside 0 to 60",
    "arx:na=-1,nb=3,delay_s=0": r"na=-1 is outside 0 to 100",
    "arx:na=101,nb=3,delay_s=0": r"na=101 is outside",
    "arx:na=1,na=2,nb=3,delay_s=0": r"na is there twice",
    "arx:na=0,nb=0,delay_s=0": r"predicts nothing; give nb=1 at least",
    "arx10+dead_zne": r"no effect 'dead_zne'; did you mean dead_zone\?",
    "arx10+warp": r"no effect 'warp'; known: .*gear_ratio",
    "arx10+": r"no effect ''",
    "arx10+dead_zone+dead_zone": r"every effect can be there once",
    "arx10B+dead_zone": r"every effect can be there once",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_says_what_is_wrong_and_what_is_known(text):
    with pytest.raises(FitError, match=MISTAKES[text]) as raised:
        parse(text)
    assert repr(text) in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("delay_s", "period_s", "samples"), [(0.5, 0.05, 10), (0.5, 0.1, 5), (0.5, 0.2, 2), (0.0, 0.2, 0), (0.29, 0.2, 1)]
)
def test_the_delay_is_the_nearest_number_of_samples_half_of_one_down(delay_s, period_s, samples):
    structure = Structure(Family.ARX, 1, 3, delay_s)
    assert structure.delay(period_s) == samples
    assert structure.model(period_s).delay == samples


def test_its_model_has_neutral_effects_and_says_nothing_yet():
    model = PRESETS["arx10B"].model(0.2)
    assert [effect.name for effect in model.effects] == ["saturation", "dead_zone", "quadratic_gain"]
    for effect in model.effects:
        assert all(getattr(effect, name) == bound.neutral for name, bound in effect.parameters.items())
    assert (model.period_s, model.na, model.nb) == (0.2, 1, 3)
    assert model.theta == (0.0,) * 5
