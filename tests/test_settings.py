"""Strict settings: every mistake names its place and its remedy, and what is written reads back equal."""

import contextlib
import enum
import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise import settings
from cruise.settings import SettingsError, load, parse, save


class Soil(enum.Enum):
    ROAD = "road"
    STUBBLE = "stubble"


class Limits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    max_accel_mps2: Annotated[float, msgspec.Meta(gt=0, le=3)]
    min_current_ma: float = 0.0
    max_current_ma: float = 1200.0

    def __post_init__(self) -> None:
        if self.min_current_ma >= self.max_current_ma:
            raise ValueError("min_current_ma has to be below max_current_ma")


class DeadZone(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="dead_zone", tag_field="effect"
):
    width_ma: float


class Curve(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="curve", tag_field="effect"):
    curvature: float = 0.0


class Cruise(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    limits: Limits
    bus: Literal["virtual", "socketcan"] = "virtual"
    soil: Soil = Soil.ROAD
    enabled: bool = True
    node_id: Annotated[int, msgspec.Meta(ge=1, le=127)] = 1
    channel: str | None = None
    gears: dict[int, float] = {}
    per_gear: dict[str, Limits] = {}
    effects: tuple[DeadZone | Curve, ...] = ()
    range_ma: tuple[float, float] = (0.0, 1200.0)
    names: Annotated[list[str], msgspec.Meta(max_length=2)] = []


GOOD = "limits:\n  max_accel_mps2: 1.0\n"


def complaint(text: str) -> str:
    with pytest.raises(SettingsError) as caught:
        parse(text, Cruise, "f.yaml")
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "limits:\n  max_acel_mps2: 1.0\n",
            "f.yaml:2: limits.max_acel_mps2: unknown setting; did you mean max_accel_mps2?",
        ),
        (GOOD + "xyzzy: 1\n", "f.yaml:3: xyzzy: unknown setting; known here: limits, bus, soil,"),
        ("bus: virtual\n", "f.yaml:1: limits: missing; add it (Limits)"),
        ("limits:\n  min_current_ma: 1\n", "f.yaml:2: limits.max_accel_mps2: missing; add it (float)"),
        ("limits:\n", "f.yaml:1: limits: expected settings, one 'key: value' a line, got nothing"),
        ("limits: 3\n", "f.yaml:1: limits: expected settings, one 'key: value' a line, got 3"),
        ("limits: {max_accel_mps2: -1}", "limits.max_accel_mps2: expected float > 0.0, got -1"),
        ("limits: {max_accel_mps2: 1 m/s2}", "expected float, got '1 m/s2'; write a plain number such as 0.5"),
        (
            'limits: {max_accel_mps2: "1"}',
            "expected float, got '1'; write a plain number such as 0.5, without unit, comma",
        ),
        ("limits: {max_accel_mps2: true}", "limits.max_accel_mps2: expected float, got True"),
        ("limits: {max_accel_mps2: .nan}", "limits.max_accel_mps2: expected a finite number, got nan"),
        ("limits: {max_accel_mps2: 1e999}", "limits.max_accel_mps2: expected a finite number, got inf"),
        (GOOD + "limits: {max_accel_mps2: 2}\n", "f.yaml:3: limits: set twice; line 1 sets it too"),
        (GOOD + "  max_accel_mps2: 2\n", "f.yaml:3: limits.max_accel_mps2: set twice; line 2 sets it too"),
        (GOOD + "  min_current_ma: 1300\n", "f.yaml:2: limits: min_current_ma has to be below max_current_ma"),
        (GOOD + "enabled: yes\n", "f.yaml:3: enabled: expected bool, got 'yes'; write true or false"),
        (GOOD + "enabled: off\n", "f.yaml:3: enabled: expected bool, got 'off'; write true or false"),
        (GOOD + "channel: 0\n", "f.yaml:3: channel: expected str | null, got 0; put it in quotes"),
        (GOOD + "node_id: 1.5\n", "f.yaml:3: node_id: expected int, got 1.5"),
        (GOOD + "node_id: 128\n", "f.yaml:3: node_id: expected int <= 127, got 128"),
        (
            GOOD + "bus: virtul\n",
            "f.yaml:3: bus: expected one of virtual, socketcan, got 'virtul'; did you mean virtual?",
        ),
        (GOOD + "soil: mud\n", "f.yaml:3: soil: expected one of road, stubble, got 'mud'"),
        (GOOD + "gears:\n  first: 1.4\n", "f.yaml:4: gears.first: expected int, got 'first'"),
        (GOOD + "gears:\n  1: 1.4\n  1: 2\n", "f.yaml:5: gears.1: set twice; line 4 sets it too"),
        (
            GOOD + "per_gear:\n  low: {max_accel_mps2: 9}\n",
            "f.yaml:4: per_gear.low.max_accel_mps2: expected float <= 3.0",
        ),
        (
            GOOD + "effects:\n- effect: dead_zone\n  with_ma: 3\n",
            "f.yaml:5: effects[0].with_ma: unknown setting; did you",
        ),
        (GOOD + "effects:\n- effect: dead_zone\n", "f.yaml:4: effects[0].width_ma: missing; add it (float)"),
        (
            GOOD + "effects:\n- effect: dead_zne\n",
            "f.yaml:4: effects[0]: invalid value 'dead_zne', got a mapping; effect: did",
        ),
        (GOOD + "range_ma: [1]\n", "f.yaml:3: range_ma: expected array of length 2, got a list"),
        (GOOD + "range_ma:\n- 1\n- two\n", "f.yaml:5: range_ma[1]: expected float, got 'two'"),
        (GOOD + "names: [a, b, c]\n", "f.yaml:3: names: expected array of length <= 2, got a list"),
        ("", "f.yaml: empty; it needs limits"),
        ("# only a comment\n", "f.yaml: empty; it needs limits"),
        ("- a\n", "f.yaml:1: expected settings, one 'key: value' a line, got a list"),
        ("limits:\n\tmax_accel_mps2: 1\n", "f.yaml:2: a tab; YAML is indented with spaces"),
        (GOOD + "---\n" + GOOD, "f.yaml:3: a second document begins"),
        ("limits: [1, 2\nbus: virtual\n", "f.yaml:2: not YAML: while parsing a flow sequence"),
        ("limits: &a {max_accel_mps2: 1}\n", "f.yaml:1: not YAML: anchors and aliases are not used here"),
        ("a: *b\n", "f.yaml:1: not YAML: anchors and aliases are not used here"),
        ("<<: {limits: {max_accel_mps2: 1}}\n", "f.yaml:1: <<: unknown setting"),
        ("limits: !!python/name:os.system x\n", "f.yaml:1: not YAML: tags are not used here; write the value alone"),
        ("? [a]\n: 1\n", "f.yaml:1: not YAML: a key has to be a word or a number"),
        ("[" * 5000, "f.yaml:1: not YAML: nested deeper than 32"),
        ("a: 1\nb: \x00\n", "f.yaml:2: character '\\x00' is not allowed; delete it"),
    ],
)
def test_a_mistake_names_its_place_and_its_remedy(text: str, expected: str):
    assert expected in complaint(text)


def test_all_mistakes_are_named_at_once():
    lines = complaint("limits:\n  max_acel_mps2: 1\nbuss: virtual\nenabled: on\n").splitlines()
    assert [line.split(" ")[0] for line in lines] == ["f.yaml:2:", "f.yaml:2:", "f.yaml:3:", "f.yaml:4:"]


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-3", 1e-3), ("1E+0", 1.0), ("2", 2.0), (".5", 0.5), ("+1.", 1.0), ("2.5e-1", 0.25), ("0x1", 1.0), ("01", 1.0)],
)
def test_a_number_is_a_number_in_every_spelling(text: str, value: float):
    read = parse(f"limits: {{max_accel_mps2: {text}}}", Cruise, "f").limits.max_accel_mps2
    assert (read, type(read)) == (value, float)


@pytest.mark.parametrize("text", ["on", "off", "yes", "no", "y", "1:30", "2024-01-22", "1_000", "=", "'12'", "can0"])
def test_text_stays_text(text: str):
    assert parse(f"{GOOD}channel: {text}\n", Cruise, "f").channel == text.strip("'")


@pytest.mark.parametrize("text", ["null", "~", ""])
def test_an_optional_setting_can_be_left_empty(text: str):
    assert parse(f"{GOOD}channel: {text}\n", Cruise, "f").channel is None


def test_defaults_stand_for_what_is_not_set():
    assert parse(GOOD, Cruise, "f") == Cruise(limits=Limits(max_accel_mps2=1.0))


def test_a_tagged_struct_is_chosen_by_its_tag():
    read = parse(
        GOOD + "effects:\n- {effect: curve, curvature: 0.5}\n- {effect: dead_zone, width_ma: 3}\n", Cruise, "f"
    )
    assert read.effects == (Curve(curvature=0.5), DeadZone(width_ma=3.0))


def test_files_that_are_not_there_or_not_text(tmp_path: Path):
    with pytest.raises(SettingsError, match=r"none\.yaml: no such file"):
        load(tmp_path / "none.yaml", Cruise)
    with pytest.raises(SettingsError, match="cannot be read: Is a directory"):
        load(tmp_path, Cruise)
    file = tmp_path / "f.yaml"
    file.write_bytes(b"limits:\n  a: \xff\n")
    with pytest.raises(SettingsError, match=r"f\.yaml:2: not UTF-8"):
        load(file, Cruise)
    file.write_text("#" * settings.MAX_BYTES + GOOD)
    with pytest.raises(SettingsError, match="longer than"):
        load(file, Cruise)


def test_windows_line_ends_and_byte_order_mark_are_fine(tmp_path: Path):
    file = tmp_path / "f.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert load(file, Cruise).limits.max_accel_mps2 == 1.0


FLOATS = st.floats(allow_nan=False, allow_infinity=False)
NAMES = st.text(st.characters(exclude_categories=["Cs"]), max_size=12) | st.sampled_from(
    ["1e-3", "on", "null", "~", "0x1F", ".inf", "*a", "- b", "a: b", "#", "\ttab", "line\nbreak", "\x85", "\ufeff", "é"]
)
CRUISES = st.builds(
    Cruise,
    limits=st.builds(Limits, max_accel_mps2=st.floats(min_value=0, max_value=3, exclude_min=True)),
    soil=st.sampled_from(Soil),
    enabled=st.booleans(),
    channel=st.none() | NAMES,
    gears=st.dictionaries(st.integers(-(10**18), 10**18), FLOATS, max_size=3),
    per_gear=st.dictionaries(NAMES, st.just(Limits(max_accel_mps2=1.0)), max_size=3),
    effects=st.lists(st.builds(DeadZone, width_ma=FLOATS) | st.builds(Curve, curvature=FLOATS), max_size=3).map(tuple),
    range_ma=st.tuples(FLOATS, FLOATS),
    names=st.lists(NAMES, max_size=2),
)


@given(CRUISES)
def test_what_is_written_reads_back_equal(cruise: Cruise):
    assert parse(settings.dump(cruise), Cruise, "f") == cruise


@given(st.text(max_size=60) | st.text("limts:_acepn-{}[],'\"\n *&!%0123.", max_size=60))
def test_any_text_gives_settings_or_a_settings_error(text: str):
    with contextlib.suppress(SettingsError):
        parse(text, Cruise, "f")


def test_saving_replaces_the_file_in_one_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    file = tmp_path / "model.yaml"
    old, new = (Cruise(limits=Limits(max_accel_mps2=value)) for value in (1.0, 2.0))
    save(file, old)
    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", lambda _: (_ for _ in ()).throw(OSError("disk full")))
        with pytest.raises(OSError, match="disk full"):
            save(file, new)
    assert load(file, Cruise) == old
    assert [path.name for path in tmp_path.iterdir()] == ["model.yaml"]
    save(file, new)
    assert load(file, Cruise) == new
    assert [path.name for path in tmp_path.iterdir()] == ["model.yaml"]


def test_saving_follows_a_link(tmp_path: Path):
    save(tmp_path / "model.yaml", Cruise(limits=Limits(max_accel_mps2=1.0)))
    (tmp_path / "link.yaml").symlink_to("model.yaml")
    save(tmp_path / "link.yaml", Cruise(limits=Limits(max_accel_mps2=2.0)))
    assert (tmp_path / "link.yaml").is_symlink()
    assert load(tmp_path / "model.yaml", Cruise).limits.max_accel_mps2 == 2.0


def test_what_could_not_be_read_back_is_not_written(tmp_path: Path):
    file = tmp_path / "model.yaml"
    with pytest.raises(ValueError, match="finite"):
        save(file, Cruise(limits=Limits(max_accel_mps2=1.0), gears={1: math.nan}))
    assert not file.exists()


def test_a_rule_of_a_section_has_no_remedy_of_another():
    said = complaint("limits: {max_accel_mps2: 1.0, min_current_ma: 1300.0}\n")
    assert said.endswith("min_current_ma has to be below max_current_ma")
