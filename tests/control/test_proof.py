"""What may not drive is refused with its reason; what the factory gives may, in every gear."""

import math
from dataclasses import replace

import pytest

from cruise import settings as strict
from cruise.control.controller import ControlSettings
from cruise.control.proof import Proof, ProofSettings
from cruise.effects.gear_ratio import GearRatio
from cruise.model import files
from cruise.model.model import Model
from cruise.settings import SettingsError
from cruise.signals import Sample
from tests.service.drive import CONFIG

FACTORY = files.load(CONFIG / "factory_model.yaml")
SIGNALS = {"gear": 2.0, "engine_speed_rpm": 2000.0}
SAMPLE = Sample(0.2, 790.0, 1.2, SIGNALS)


def findings(model: Model, others=(FACTORY,), settings: ProofSettings | None = None):
    before = FACTORY.apply(FACTORY.start(1.2, 790.0, SIGNALS), 790.0, SIGNALS)
    return list(Proof(ControlSettings(), settings or ProofSettings())(model, others, before, SAMPLE))


def against(model: Model, others=(FACTORY,), settings: ProofSettings | None = None) -> str:
    """The first word against it, which is where the supervisor stops to ask."""
    return next((one.against for one in findings(model, others, settings) if one.against), "")


def changed(a_1=None, b=None, factor=1.0):
    a, taps, loads, c_0 = FACTORY.split(FACTORY.theta)
    return FACTORY.with_theta((a[0] if a_1 is None else a_1, *(factor * one for one in (b or taps)), *loads, c_0))


def test_the_factory_model_may_drive_in_every_gear():
    found = findings(FACTORY)
    assert against(FACTORY) == ""
    judged = [one.figures for one in found if "gain_margin" in one.figures]
    assert len(judged) == 5  # first and second gear have the same pace; the others each gain of the observer
    for figures in judged:
        assert figures["gain_margin"] == figures["wrong_gain_margin"] > 1.8
        assert figures["phase_margin_deg"] > 40.0


def test_a_drive_that_yields_by_its_stroke_is_judged_creeping_and_hurrying():
    """First and second gear have one gain of the observer, the others two."""
    yielding = replace(FACTORY, stroke_share=0.6)
    judged = [one.figures for one in findings(yielding, (yielding,)) if "gain_margin" in one.figures]
    assert len(judged) == (2 + 2 * 2) * 2
    assert len({figures["phase_margin_deg"] for figures in judged}) == len(judged)


@pytest.mark.parametrize(
    ("model", "why"),
    [
        (changed(a_1=1.02, factor=-1.0), "not stable"),  # its steady gain is positive
        (changed(a_1=-1.1), "not stable"),
        (changed(factor=-1.0), "gain is not positive"),
        (changed(factor=0.0), "gain is not positive"),
        (changed(b=(-5e-4, 1e-4, 24e-4)), "delay is not within"),
        (changed(b=(24e-4, 1e-4, -5e-4)), "delay is not within"),
        (changed(factor=0.5), "margins are too small"),  # twice as strong a law on the machine as the factory made it
        (FACTORY.with_theta([math.nan] * len(FACTORY.theta)), "not stable"),
    ],
)
def test_what_may_not_drive_is_refused_with_its_reason(model, why):
    assert why in against(model)


def test_the_margin_around_the_one_that_drives_counts_too():
    assert against(changed(factor=0.7)) == ""
    assert against(changed(factor=0.7), (FACTORY, changed(factor=1.6))) == "its margins are too small"


def test_the_margins_with_the_gain_for_what_lasts_count_too(monkeypatch: pytest.MonkeyPatch):
    """In fourth and third gear, slowest first, where that gain is the quicker one."""
    judged = [one.figures["gain_margin"] for one in findings(FACTORY) if "gain_margin" in one.figures]
    assert judged[1] < 0.8 * judged[0]
    assert judged[3] < 0.9 * judged[2]
    monkeypatch.setattr("cruise.control.proof.GAINS", (0.0,))
    assert [one.figures["gain_margin"] for one in findings(FACTORY) if "gain_margin" in one.figures] == judged[::2]


def test_the_least_margins_are_settings():
    assert against(FACTORY, settings=ProofSettings(gain_margin=2.5)) == "its margins are too small"
    assert against(FACTORY, settings=ProofSettings(phase_margin_deg=70.0)) == "its margins are too small"
    assert against(changed(factor=0.7), settings=ProofSettings(wrong_gain_margin=1.8)) == "its margins are too small"


def test_a_gear_without_drive_is_no_positive_gain():
    stuck = replace(FACTORY, effects=(*FACTORY.effects[:-1], GearRatio(1.4, 2.5, 4.4, 0.0)))
    assert "gain is not positive" in against(stuck)


@pytest.mark.parametrize("text", ["gain_margin: 1.0", "phase_margin_deg: 0", "wrong_phase_margin_deg: 90", "margin: 2"])
def test_margins_that_guard_nothing_are_no_settings(text):
    with pytest.raises(SettingsError):
        strict.parse(text, ProofSettings, "settings")
