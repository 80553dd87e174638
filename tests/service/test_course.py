"""A drive as rows: ramps, buttons, and how another day varies it."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.service import course
from cruise.service.course import Drive, FieldRow, OperatorRow, pressed, value_at, vary
from cruise.service.operator_node import OperatorNode
from cruise.settings import SettingsError
from tests.service.drive import CONFIG, codec

ROWS = (
    FieldRow(at_s=1.0, grade_deg=2.0),
    FieldRow(at_s=4.0, gear=3),
    FieldRow(at_s=5.0, over_s=4.0, grade_deg=-2.0),
    FieldRow(at_s=8.0, over_s=2.0, grade_deg=3.0),
)


@pytest.mark.parametrize(
    ("time_s", "grade_deg"),
    [
        (0.0, 0.5),  # as it was before any row
        (0.999, 0.5),
        (1.0, 2.0),  # at once
        (5.0, 2.0),
        (6.0, 1.0),  # a quarter of the way
        (8.0, -1.0),  # the next row takes over where the ramp is
        (9.0, 0.5),  # half-way from the first ramp's end, which goes on underneath, to 3
        (10.0, 3.0),
        (1e6, 3.0),
    ],
)
def test_a_value_moves_linearly_and_holds(time_s, grade_deg):
    assert value_at(ROWS, "grade_deg", 0.5, time_s) == pytest.approx(grade_deg)


def test_a_column_that_no_row_names_keeps_its_start():
    assert value_at(ROWS, "crop_power_kw", 12.0, 100.0) == 12.0
    assert value_at(ROWS, "gear", 2, 3.9) == 2
    assert value_at(ROWS, "gear", 2, 4.0) == 3


@given(st.floats(0.0, 12.0))
def test_ramps_have_no_jump(time_s):
    ramps = tuple(row for row in ROWS if row.over_s > 0.0)
    step = abs(value_at(ramps, "grade_deg", 2.0, time_s + 1e-4) - value_at(ramps, "grade_deg", 2.0, time_s))
    assert step < 1e-3


def test_a_button_is_down_for_as_long_as_it_is_pressed():
    rows = (OperatorRow(at_s=2.0, press="set"), OperatorRow(at_s=3.0, press="coast", press_s=0.2))
    down = [time_s for time_s in (1.99, 2.0, 2.49, 2.5, 3.0) if pressed(rows, "set", time_s)]
    assert down == [2.0, 2.49]
    assert pressed(rows, "coast", 3.1)
    assert not pressed(rows, "coast", 3.2)
    assert not pressed(rows, "resume", 2.1)


def test_seed_zero_is_the_drive_as_written_and_every_seed_is_itself():
    drive = course.load(CONFIG / "demo.yaml")
    assert vary(drive, 0) is drive
    assert vary(drive, 3) == vary(drive, 3)
    assert vary(drive, 3) != vary(drive, 4) != drive


def close_rows(cls, at_s, **columns):
    return tuple(cls(at_s=round(time_s, 2), **columns) for time_s in sorted(at_s))


@given(
    seed=st.integers(1, 10_000),
    field_s=st.lists(st.floats(0.0, 20.0), max_size=12),
    operator_s=st.lists(st.floats(0.0, 20.0), max_size=12),
)
def test_rows_keep_their_order_and_stay_after_the_start_however_close_they_are(seed, field_s, operator_s):
    drive = Drive(
        seconds=30.0,
        field=close_rows(FieldRow, field_s, grade_deg=4.0),
        operator=close_rows(OperatorRow, operator_s, brake_pedal=1.0, setpoint_mps=1.5),
    )
    varied = vary(drive, seed)
    for before, after in ((drive.field, varied.field), (drive.operator, varied.operator)):
        for old, new in zip(before, after, strict=True):
            assert abs(new.at_s - old.at_s) <= 1.5 + 0.005
            assert new.at_s >= 0.0
        for (old, old_next), (new, new_next) in zip(pairwise(before), pairwise(after), strict=True):
            assert new.at_s <= new_next.at_s
            if old_next.at_s - old.at_s > 0.1:  # a pedal that was pressed and released still is
                assert new.at_s < new_next.at_s
    for new in varied.field:
        assert new.grade_deg is not None
        assert 3.6 <= new.grade_deg <= 4.4
    for new in varied.operator:
        assert new.setpoint_mps is not None
        assert 1.35 <= new.setpoint_mps <= 1.65
        assert new.brake_pedal == 1.0


def test_a_variation_does_vary():
    drive = course.load(CONFIG / "demo.yaml")
    starts_s = {next(row.at_s for row in vary(drive, seed).operator if row.press) for seed in range(1, 30)}
    assert len(starts_s) > 20
    assert max(starts_s) - min(starts_s) > 2.0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("seconds: 10.0\noperator:\n  - {at_s: 1.0, press: sett}\n", r":3: .*press"),
        ("seconds: 10.0\nfield:\n  - {at_s: 1.0, grade: 2.0}\n", r":3: .*grade: .*grade_deg"),
        ("seconds: 10.0\nfield:\n  - {at_s: 5.0, gear: 2}\n  - {at_s: 1.0, gear: 3}\n", "order of at_s"),
    ],
)
def test_a_mistake_in_a_drive_is_shown_with_its_place(tmp_path, text, complaint):
    path = tmp_path / "drive.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=complaint):
        course.load(path)


def panel_says(rows: tuple[OperatorRow, ...], time_s: float) -> dict[str, float]:
    """What the panel's two frames at one time decode to."""
    panel, ear = OperatorNode(codec(), rows), codec()
    decoded = [ear.decode(frame) for frame in panel.tick(time_s)]
    assert [one.message for one in decoded] == ["CCVS", "MachineSelectedSpeedCommand"]
    return {reading.name: reading.value for one in decoded for reading in one.readings}


def test_the_panels_frames_follow_the_rows():
    rows = (
        OperatorRow(at_s=0.0, cruise_enable=1.0),
        OperatorRow(at_s=1.0, press="resume", press_s=0.3),
        OperatorRow(at_s=2.0, brake_pedal=0.3, clutch_pedal=1.0),  # a pedal's switch closes half-way
        OperatorRow(at_s=3.0, over_s=1.0, brake_pedal=0.8, setpoint_mps=1.234),
    )
    before, resuming, braking, later = (panel_says(rows, time_s) for time_s in (0.5, 1.1, 2.0, 4.0))
    assert (before["cruise_enable"], before["cruise_set"], before["brake_pedal"]) == (1.0, 0.0, 0.0)
    assert math.isnan(before["setpoint_mps"])
    assert (resuming["cruise_resume"], resuming["cruise_set"]) == (1.0, 0.0)
    assert (braking["brake_pedal"], braking["clutch_pedal"]) == (0.0, 1.0)
    assert (later["brake_pedal"], later["setpoint_mps"]) == (1.0, pytest.approx(1.234))
