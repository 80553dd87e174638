"""`cruise effects` as a user meets it."""

import json
import re

import numpy as np
import pytest

from cruise.cli import effects_picture
from cruise.cli.effects import CUSTOM, STAGES, bounds, headline, symbols
from cruise.effects import EFFECTS, Stage
from cruise.signals import SIGNALS

ALL = {name: kind() for name, kind in EFFECTS.items()} | {"custom": CUSTOM}


def joined(text: str) -> str:
    return " ".join(text.split())


def test_the_list_holds_every_effect_under_its_stage_with_what_it_needs(verb):
    code, out, err = verb("effects")
    assert (code, err) == (0, "")
    assert max(map(len, out.splitlines())) <= 80
    stages = {stage: out.index(f"{stage} effects {does}") for stage, does in STAGES.items()}
    assert list(stages) == list(Stage)
    for effect in (kind() for kind in EFFECTS.values()):
        at = out.index(f"\n  {effect.name} ")
        assert [stage for stage, start in stages.items() if start < at][-1] == effect.stage
        row = re.split(r"\n {1,2}\S", out[at + 3 :])[0]
        assert all(name in row for name in effect.needs)
        assert all(f"    {name} " in row and f" {bounds(one)} " in row for name, one in effect.parameters.items())


@pytest.mark.parametrize("name", ALL)
def test_an_effect_is_explained_in_full(verb, name):
    code, out, err = verb("effects", name)
    assert (code, err) == (0, "")
    assert max(map(len, out.splitlines())) <= 80
    effect, told = ALL[name], joined(out)
    about = effect.about
    for part in (about.physics, about.source, about.signature, about.experiment, symbols(effect)):
        assert joined(part) in told
    assert joined(about.equation) in told
    for needed in (*effect.needs, *effect.helps):
        assert joined(f"{needed}: {SIGNALS[needed].meaning}") in told
    for key, one in effect.parameters.items():
        assert joined(f"{key} {bounds(one)}, neutral {one.neutral:g}: {one.meaning}") in told
    for other in about.look_alikes:
        assert other in EFFECTS
        assert headline(ALL[other]) in told


@pytest.mark.parametrize("name", ALL)
def test_headline_and_symbols_are_found_in_the_module(name):
    assert headline(ALL[name]).endswith(".")
    assert headline(ALL[name]).lower().replace(" ", "_").startswith(name)
    assert len(symbols(ALL[name])) > 20
    assert "Source" not in symbols(ALL[name])


def test_json_is_json_and_nothing_else(verb):
    def refuse(word: str) -> None:
        pytest.fail(f"{word} is no JSON")

    listed = json.loads(verb("effects", "--json")[1], parse_constant=refuse)["effects"]
    assert [one["name"] for one in listed] == list(EFFECTS)
    one = json.loads(verb("effects", "rate_limit", "--json", "--picture", "p.png")[1], parse_constant=refuse)
    assert one.pop("picture") == "p.png"
    assert one == listed[list(EFFECTS).index("rate_limit")]
    assert one["parameters"]["rate_ma_per_s"]["unit"] == "mA/s"


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["hysterisis"], "no effect is called hysterisis; did you mean hysteresis?"),
        (["ENGINE-SPEED"], "did you mean engine_speed?"),
        (["zzz"], "known: "),
        (["--picture", "p.png"], "name the effect to draw"),
        (["grade", "--picture", "p.txt"], "let the name end in .png"),
    ],
)
def test_a_mistake_ends_with_one_clear_line(verb, words, complaint):
    code, out, err = verb("effects", *words)
    assert (code, out) == (2, "")
    assert complaint in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("name", ["hysteresis", "gear_ratio", "sensor_bias"])
def test_the_picture_is_drawn(verb, tmp_path, name):
    code, out, _ = verb("effects", name, "--picture", "new/p.png")
    assert code == 0
    assert "picture: new/p.png" in out
    assert (tmp_path / "new" / "p.png").read_bytes().startswith(b"\x89PNG")


class Paper:
    """Takes what a panel draws."""

    def __init__(self) -> None:
        self.lines: dict[str, np.ndarray] = {}

    def plot(self, x, y, label, **style) -> None:
        assert len(x) == len(y)
        self.lines[label] = np.asarray(y, float)

    def set_title(self, text, **style) -> None:
        assert "nan" not in text

    def set_xlabel(self, text) -> None:
        assert text

    set_ylabel = set_xlabel


@pytest.mark.parametrize("name", ALL)
def test_every_picture_shows_what_the_effect_does(name):
    drawn = effects_picture.curves(ALL[name])
    for one in drawn:
        for key, bound in one.effect.parameters.items():
            assert bound.low <= getattr(one.effect, key) <= bound.high
    changes = 0.0
    for panel in effects_picture.panels_of(ALL[name]):
        paper = Paper()
        panel(paper, drawn)
        assert all(np.isfinite(line).all() for line in paper.lines.values())
        first, last = paper.lines[drawn[0].label], paper.lines[drawn[-1].label]
        reference = paper.lines.get("without", np.full(len(first), np.mean(first))) if len(drawn) == 1 else first
        changes = max(changes, float(np.max(np.abs(last - reference)) / max(np.ptp(reference), np.max(np.abs(last)))))
    assert changes > 0.1


def test_curves_stand_at_neutral_a_quarter_and_half_of_the_way():
    def of(name: str, parameter: str) -> list[float]:
        return [getattr(one.effect, parameter) for one in effects_picture.curves(ALL[name])]

    assert of("hysteresis", "width_ma") == [0.0, 100.0, 200.0]
    assert of("rate_limit", "rate_ma_per_s") == pytest.approx([10000.0, 1e4 * 0.005**0.25, 1e4 * 0.005**0.5])
    assert of("oil_temperature", "loss_share") == [0.0, 0.1, 0.2]
    gears = effects_picture.curves(ALL["gear_ratio"])[-1].effect
    tops = [getattr(gears, f"gear_{i}_mps") for i in (1, 2, 3, 4)]
    assert tops == sorted(tops)
    assert tops[3] > 3.0 * tops[1]


def test_an_input_is_held_until_the_effect_has_settled():
    slip = EFFECTS["wheel_slip"]().reshaped(share=0.75)
    gain = effects_picture.settled(slip, "wheel_speed_mps", np.array([1.5, 3.0]))  # over ground at 1.5 m/s
    np.testing.assert_allclose(gain, [1.0, 1.0 - 0.75 * 0.5])


def test_the_machine_of_the_picture_has_its_delay_and_its_time_constant():
    step = np.where(np.arange(200) < 20, 400.0, 800.0)
    speed = effects_picture.answer(None, step)
    assert speed[27] == pytest.approx(1.0)
    assert speed[28 + 11] == pytest.approx(1.0 + (1.0 - np.exp(-1.0)))  # 0.4 s and 0.6 s after the step
    late = effects_picture.answer(EFFECTS["transport_delay"]().reshaped(delay_s=0.5), step)
    np.testing.assert_allclose(late[10:], speed[:-10])
    assert effects_picture.answer(EFFECTS["resonance"](), step).max() > 2.01  # overshoots
