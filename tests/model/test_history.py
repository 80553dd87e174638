"""Histories: every step can be taken back exactly, and one that can't be true is refused."""

import pytest
from msgspec import structs

from cruise import settings
from cruise.model import files
from cruise.model.core import Core, discretised
from cruise.model.files import ModelFile, PhysicalCore, Provenance, Step
from cruise.model.history import fields_of, history_of, names_of, undone
from cruise.model.model import Model
from cruise.settings import SettingsError
from tests.model.test_core import written

PATH = "better.yaml"


def step(**own) -> Step:
    known = {
        "error_after_mps": 0.03,
        "horizon_s": 3.0,
        "recordings": ("a.csv, 0 to 60 s",),
        "samples": 300,
        "made_on": "2026-11-21",
    }
    return Step(**(known | own))


def rung(model: ModelFile, *history: Step) -> ModelFile:
    return structs.replace(model, history=history)


CORE = Core(0.0025, 0.3, 0.15, 0.6)
BARE, _ = written(CORE)  # dead_zone
HILLS, _ = written(CORE, (0.05,))  # and grade
LEAKY, _ = written(CORE, (0.05, -0.02))  # and leakage
START = step(structure="arx10+dead_zone", error_after_mps=0.07)
ADDED_GRADE = step(effect="grade", error_before_mps=0.07, before=fields_of(BARE))
ADDED_LEAKAGE = step(effect="leakage", error_before_mps=0.03, before=fields_of(HILLS), floor_at_least_mps=0.01)
LADDER = rung(LEAKY, START, ADDED_GRADE, ADDED_LEAKAGE)


def test_a_history_reads_back_equal_and_the_model_drives(tmp_path):
    settings.save(tmp_path / PATH, LADDER)
    file = files.read(tmp_path / PATH)
    assert file == LADDER
    assert history_of(PATH, file) == LADDER.history
    assert files.load(tmp_path / PATH) == files.model_of(PATH, LEAKY)


def test_every_step_is_taken_back_exactly():
    once = undone(PATH, LADDER)
    assert once == rung(HILLS, START, ADDED_GRADE)
    assert undone(PATH, once) == rung(BARE, START)
    with pytest.raises(SettingsError, match="nothing to take back"):
        undone(PATH, undone(PATH, once))


def test_a_model_file_without_history_comes_back_as_it_was():
    plain = files.file_of("m.yaml", Model(0.2, 1, 1, 2, (), (0.5, 1e-3, 0.0)), Provenance(note="by hand"), "oe")
    model = discretised(CORE, (), (), 0.0, 0.2)
    core = PhysicalCore(
        gain_mps_per_ma=0.0025, delay_s=0.3, lag_s=0.15, time_constant_s=0.6, effects=("transport_delay",)
    )
    last = step(effect="transport_delay", error_before_mps=0.05, before=fields_of(plain))
    later = files.file_of("m.yaml", model, Provenance(), core=core, history=(last,))
    assert undone(PATH, later) == plain
    with pytest.raises(SettingsError, match="nothing to take back"):
        undone(PATH, plain)


def test_an_effect_of_the_core_is_an_effect():
    assert names_of(LEAKY) == {"dead_zone", "grade", "leakage"}
    assert LEAKY.core is not None
    assert names_of(structs.replace(LEAKY, core=structs.replace(LEAKY.core, effects=("resonance",)))) == {
        "dead_zone",
        "grade",
        "leakage",
        "resonance",
    }


NONSENSE = {
    "an effect that is not there": (
        (START, structs.replace(ADDED_GRADE, effect="crop_load"), ADDED_LEAKAGE),
        r"history\[1\]: crop_load is said to have been added to dead_zone, but the model after it has dead_zone, grade",
    ),
    "a step left out": ((START, ADDED_GRADE), r"history\[1\]: grade is said .* after it has dead_zone, grade, leakage"),
    "steps exchanged": ((START, ADDED_LEAKAGE, ADDED_GRADE), r"history\[1\]: leakage is said"),
    "one that was there": (
        (START, ADDED_GRADE, structs.replace(ADDED_LEAKAGE, before=fields_of(LEAKY))),
        r"history\[1\]: grade is said",
    ),
    "the last one there already": (
        (
            START,
            structs.replace(ADDED_LEAKAGE, before=fields_of(LEAKY)),
        ),
        r"history\[1\]: leakage is said to have been added to dead_zone, grade, leakage",
    ),
    "nothing before": (
        (START, ADDED_GRADE, structs.replace(ADDED_LEAKAGE, before=None)),
        r"history\[2\]\.before: missing",
    ),
    "a first step out of nothing": ((structs.replace(ADDED_LEAKAGE, before=None),), r"history\[0\]\.before: missing"),
    "an error out of nothing": (
        (START, ADDED_GRADE, structs.replace(ADDED_LEAKAGE, error_before_mps=None)),
        r"history\[2\]\.error_before_mps: missing",
    ),
    "a model before that is none": (
        (START, ADDED_GRADE, structs.replace(ADDED_LEAKAGE, before=structs.replace(fields_of(HILLS), parameters={}))),
        r"history\[2\]\.before: parameters: a_1",
    ),
    "no name": ((START, structs.replace(ADDED_GRADE, effect=""), ADDED_LEAKAGE), r"history\[1\]: nothing is said"),
}


@pytest.mark.parametrize("case", NONSENSE)
def test_a_history_that_can_not_be_true_is_refused(case):
    history, complaint = NONSENSE[case]
    file = rung(LEAKY, *history)
    for act in (history_of, undone):
        with pytest.raises(SettingsError, match=complaint) as raised:
            act(PATH, file)
        assert str(raised.value).startswith(PATH)
        assert "\n" not in str(raised.value)
    files.model_of(PATH, file)  # a machine drives with the model whatever is told of its past


EDITS = {
    "error no number": ("error_after_mps: 0.07", "error_after_mps: small", r"history\[0\]\.error_after_mps: .*'small'"),
    "error negative": ("error_after_mps: 0.07", "error_after_mps: -0.07", r"history\[0\]\.error_after_mps"),
    "key misspelt": (
        "- effect: grade",
        "- efect: grade",
        r"history\[1\]\.efect: unknown setting; did you mean effect\?",
    ),
    "no recordings": ("  recordings:\n  - a.csv, 0 to 60 s\n", "  recordings: []\n", r"history\[\d\]\.recordings"),
    "no date": ("  made_on: 2026-11-21\n", "", r"history\[\d\]\.made_on: missing"),
    "deep inside": ("    period_s: 0.2", "    period_s: 0", r"history\[1\]\.before\.period_s"),
}


@pytest.mark.parametrize("edit", EDITS)
def test_a_mistake_in_a_history_says_where(tmp_path, edit):
    before, after, complaint = EDITS[edit]
    settings.save(tmp_path / PATH, LADDER)
    text = (tmp_path / PATH).read_text()
    assert before in text
    (tmp_path / PATH).write_text(text.replace(before, after, 1))
    with pytest.raises(SettingsError, match=complaint):
        files.read(tmp_path / PATH)
