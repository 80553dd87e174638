"""`cruise effects` as a user meets it."""

import json
import re

import numpy as np
import pytest

from cruise.cli import effects_picture
from cruise.cli.effects import CUSTOM, STAGES, bounds, headline, in_full, symbols
from cruise.cli.effects_courses import COURSES
from cruise.effects import EFFECTS, Stage
from cruise.signals import SIGNALS

ALL = {name: kind() for name, kind in EFFECTS.items()} | {"custom": CUSTOM}
VISIBLE = 0.02  # of the height of a line: seven pixels


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
    assert ", -\n" not in out, "what has no unit is followed by none"
    assert ("none beside its coefficient" in told) == (not effect.parameters and effect.acts_as == "load")
    assert ("none of its own: the core holds them" in told) == (name == "resonance")
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


UNITS = re.compile(r"\d ?(m/s2|m/s|kg|bar|degC|rpm|mA|K|%)(?![\w^])|in m/s|, a (?=[a-z])|through a ")
SUBSCRIPTS = re.compile(r"_\(?k[^ ,)]*\)?")
SYMBOL = re.compile(
    r"(?<![\w,])((?:alpha|delta|kappa|lambda|tau|theta|phi|[A-Za-z])(?:_(?!\()[a-z0-9]+(?:,i)?)?)(?![A-Za-z])"
)


@pytest.mark.parametrize("name", EFFECTS)
def test_every_symbol_of_the_equations_is_explained(verb, name):
    effect, explained = ALL[name], symbols(ALL[name])
    used = SYMBOL.findall(SUBSCRIPTS.sub("", UNITS.sub("0", " ; ".join([effect.about.equation, *in_full(effect)]))))
    missing = {one for one in used if not re.search(rf"(?<!\w){re.escape(one)}(?!\w)", explained)}
    assert not missing, "in an equation of `cruise effects`, and in no word about it"
    told = joined(verb("effects", name)[1])
    assert all(joined(one) in told for one in in_full(effect))


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


def drawn_panels(name: str) -> list[dict[str, np.ndarray]]:
    """The lines of each panel by their label, those of the effect in the order of its curves."""
    papers = []
    for panel in effects_picture.panels_of(ALL[name]):
        paper = Paper()
        panel(paper, effects_picture.curves(ALL[name]))
        papers.append(paper.lines)
    return papers


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """The greatest distance of two lines as a share of the height of the higher one, or of its level."""
    height = max(np.ptp(one), np.ptp(other)) or max(np.abs(one).max(), np.abs(other).max())
    return float(np.max(np.abs(one - other)) / height)


@pytest.mark.parametrize("name", ALL)
def test_every_picture_shows_what_the_effect_does(name):
    first, *others = effects_picture.curves(ALL[name])
    for one in (first, *others):
        for key, bound in one.effect.parameters.items():
            assert bound.low <= getattr(one.effect, key) <= bound.high
    panels = drawn_panels(name)
    assert all(np.isfinite(line).all() for lines in panels for line in lines.values())
    for other in others:
        assert max(difference(lines[first.label], lines[other.label]) for lines in panels) > VISIBLE
    if not others:
        without = [
            lines.get("without", np.full_like(line, np.mean(line))) for lines in panels for line in lines.values()
        ]
        assert (
            max(difference(*pair) for pair in zip(without, [lines[name] for lines in panels], strict=False)) > VISIBLE
        )


@pytest.mark.parametrize("name", [name for name, effect in ALL.items() if len(effect.parameters) > 1])
def test_every_picture_shows_what_each_further_parameter_does(name):
    neutral, _, strong, *held_back = effects_picture.curves(ALL[name])
    gears = {f"gear_{i}_mps" for i in (1, 2, 3, 4)}  # several of one kind: spread out, not held back one by one
    drawn = [key for key in ALL[name].parameters if key not in {*ALL[name].instead, *gears}]
    assert len(held_back) == len(drawn) - 1
    for one, key in zip(held_back, drawn[1:], strict=True):
        other = ALL[name].parameters[key].high if key == ALL[name].kind else getattr(neutral.effect, key)
        assert one.effect == strong.effect.reshaped(**{key: other})
        assert max(difference(lines[strong.label], lines[one.label]) for lines in drawn_panels(name)) > VISIBLE


@pytest.mark.parametrize(
    "name", [name for name, kind in EFFECTS.items() if kind.acts_as in (Stage.GAIN, Stage.LOAD) and kind().start(0.0)]
)
def test_a_gain_or_load_with_a_memory_is_drawn_in_time(name):
    assert name in COURSES


def test_a_bias_is_drawn_as_it_comes_to_be_known():
    (lines,) = drawn_panels("sensor_bias")
    slow, _, quick, shown_at_rest = (lines[one.label] for one in effects_picture.curves(ALL["sensor_bias"]))
    read = lines["ground speed - wheel speed (m/s)"]
    assert (read[0], read[-1], slow[0]) == (0.0, pytest.approx(0.3), 0.0)
    step = int(np.argmax(read > 0.0))
    assert quick[step + 110] == pytest.approx(0.3 * (1.0 - np.exp(-1.0)), rel=0.03)  # its 5.5 s later
    assert slow[step + 110] < 0.6 * quick[step + 110]
    at_rest = int(np.argmax(COURSES["sensor_bias"].speed_mps == 0.0)) + 1
    assert quick[at_rest] == pytest.approx(0.5 * shown_at_rest[at_rest], rel=0.05)  # rest_share is half there


def test_slip_is_drawn_as_the_load_by_which_the_ground_lags():
    static, lines = drawn_panels("wheel_slip")
    slow, _, quick = (lines[one.label] for one in effects_picture.curves(ALL["wheel_slip"]))
    lag = lines["ground speed - wheel speed (m/s)"]
    assert lag.min() == pytest.approx(-0.5)
    assert quick[80] == pytest.approx(lag[80], rel=0.01)  # after 3 s of slip
    assert abs(slow[30]) < 0.5 * abs(quick[30])
    assert next(iter(static.values()))[-1] == pytest.approx(2.0 - 3.0)  # ground at 2 m/s, wheels at 3 m/s


def test_dry_friction_is_drawn_from_rest_to_rest_and_in_reverse():
    (lines,) = drawn_panels("coulomb_friction")
    neutral, _, strong, even, short = (lines[one.label] for one in effects_picture.curves(ALL["coulomb_friction"]))
    assert neutral[0] == even[0] == 0.0
    assert even[80] == neutral[80] == -1.0  # 4 s, forward
    assert -1.0 < even[160] < -0.2  # 8 s, at rest: what still holds
    assert even[-1] == 1.0
    assert strong.min() < -1.5  # more of it at a creep, and
    assert short[80] == pytest.approx(-1.0, abs=1e-3)  # none of that at speed


def test_curves_stand_at_neutral_a_quarter_and_half_of_the_way():
    def of(name: str, parameter: str) -> list[float]:
        return [getattr(one.effect, parameter) for one in effects_picture.curves(ALL[name])]

    assert of("hysteresis", "width_ma") == [0.0, 100.0, 200.0, 200.0, 200.0]
    assert of("rate_limit", "rate_ma_per_s") == pytest.approx(
        [1e4, *(1e4 * 0.002**share for share in (0.25, 0.5, 0.5, 0.5))]
    )
    assert of("oil_temperature", "loss_share") == [0.0, 0.1, 0.2]
    gears = effects_picture.curves(ALL["gear_ratio"])[-1].effect
    tops = [getattr(gears, f"gear_{i}_mps") for i in (1, 2, 3, 4)]
    assert tops == sorted(tops)
    assert tops[3] > 3.0 * tops[1]


def test_an_input_is_held_until_the_effect_has_settled():
    hill = EFFECTS["grade"]().reshaped(filter_s=4.0)
    phi = effects_picture.settled(hill, "pitch_deg", np.array([0.0, 15.0]))
    np.testing.assert_allclose(phi, [0.0, -9.81 * np.sin(np.radians(15.0))], atol=1e-9)
    slip = effects_picture.settled(EFFECTS["wheel_slip"](), "wheel_speed_mps", np.array([2.0, 2.5]))
    np.testing.assert_allclose(slip, [0.0, -0.5], atol=1e-9)  # over ground at 2 m/s


def test_a_long_title_ends_its_lines_between_two_parts_of_the_equation():
    for effect in ALL.values():
        panels = len(effects_picture.panels_of(effect))
        lines = effects_picture.title_of(effect, panels).split("\n")
        assert "  ".join(lines) == f"{effect.name}:  {effect.about.equation}"
        assert max(map(len, lines)) <= 88 * panels


def test_the_machine_of_the_picture_has_its_delay_and_its_time_constant():
    step = np.where(np.arange(200) < 20, 400.0, 800.0)
    speed = effects_picture.answer(None, step)
    assert speed[27] == pytest.approx(1.0)
    assert speed[28 + 11] == pytest.approx(1.0 + (1.0 - np.exp(-1.0)))  # 0.4 s and 0.6 s after the step
    late = effects_picture.answer(EFFECTS["transport_delay"]().reshaped(delay_s=0.5), step)
    np.testing.assert_allclose(late[10:], speed[:-10])
    assert effects_picture.answer(EFFECTS["resonance"](), step).max() > 2.01  # overshoots
