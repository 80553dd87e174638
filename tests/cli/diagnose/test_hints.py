"""Columns under names of their own that may be a signal which cruise knows are said to be, with how to say so."""

from dataclasses import replace

import numpy as np

from cruise.report.mapping import hints
from cruise.validation.candidates import Refused
from cruise.validation.diagnose import Verdict
from cruise.validation.unnamed import SPEED
from tests.cli.diagnose.drives import unlisted


def test_a_column_that_may_be_what_an_effect_lacked_is_said_to(hills):
    (recording,) = hills.study.recordings
    columns = {"Slope [%]" if name == "pitch_deg" else name: values for name, values in recording.columns.items()}
    own = replace(hills.study, recordings=(replace(recording, columns=columns),))
    lacking = (Refused("grade", "pitch_deg is not recorded"), Refused("gear_ratio", "gear is not recorded"))
    found = replace(unlisted(hills), study=own, signals=("Slope [%]",), refused=lacking)
    assert (
        "if `Slope [%]` is pitch_deg, the pitch of the machine (+ uphill), "
        'columns: {"Slope [%]": {signal: pitch_deg, scale: 0.572958}} in the file of --columns says so; '
        "then `grade` can be tried"
    ) in hints(found)
    beside = replace(found, verdict=hills.verdict, effects=hills.effects, signals=(), beside="Slope [%]")
    assert len(hints(beside)) == 1
    assert hints(replace(found, signals=("header_height",))) == []
    assert hints(replace(found, refused=())) == hints(hills) == []
    slip = (Refused("wheel_slip", "wheel_speed_mps is not recorded"),)
    assert hints(replace(found, signals=(SPEED,), refused=slip)) == [], "no column of theirs"


def test_a_brake_under_a_name_of_its_own_is_said_to_act_beside_the_drive(hills):
    (recording,) = hills.study.recordings
    kpa = np.where(np.arange(len(recording)) % 100 < 10, 800.0, 0.0)
    columns = {**recording.columns, "brake_pressure_kpa": kpa, "brakeman": kpa}
    braked = replace(hills, study=replace(hills.study, recordings=(replace(recording, columns=columns),)))
    assert hints(braked) == [
        "if `brake_pressure_kpa` is of a brake beside the drive, columns: {brake_pressure_kpa: {signal: brake_pedal, "
        "scale: 0.013}} in the file of --columns leaves the speed out where that acts"
    ]
    assert hints(replace(braked, verdict=Verdict.NOTHING)) == hints(hills) == []
    mapped = replace(recording, columns=columns, notes=("brake_pedal and clutch_pedal: pressed for 20 s",))
    assert hints(replace(braked, study=replace(hills.study, recordings=(mapped,)))) == []
