"""Which columns, which model and which numbers the command line means."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.cli import reading
from cruise.effects.dead_zone import DeadZone
from cruise.identification.named import model_named
from cruise.identification.regressors import FitError
from cruise.identification.structures import PRESETS, Family, parse
from cruise.model import files
from cruise.model.files import Provenance
from cruise.model.model import Model
from cruise.recording import Recording, RecordingError, notes_of
from cruise.settings import SettingsError
from cruise.signals import INPUT, OUTPUT


def test_a_name_a_structure_and_a_file_are_told_apart(tmp_path):
    assert model_named("arx10B") == (PRESETS["arx10B"], None)
    written = "oe:nf=2,nb=1,delay_s=0.4+dead_zone"
    assert model_named(written) == (parse(written), None)
    model = Model(0.1, 1, 2, 3, (DeadZone(400.0),), (0.5, 1e-4, 1e-4, 0.0))
    files.save(tmp_path / "m.yaml", model, Provenance(), "armax", (0.3, 0.1))
    structure, start = model_named(str(tmp_path / "m.yaml"))
    assert (structure.family, structure.na, structure.nb, structure.nc) == (Family.ARMAX, 1, 2, 2)
    assert structure.delay_s == pytest.approx(0.3)
    assert structure.effects == ("dead_zone",)
    assert start == model


def test_a_file_that_is_not_there_is_no_misspelt_name(tmp_path):
    with pytest.raises(SettingsError, match="no such file"):
        model_named(str(tmp_path / "none.yaml"))
    with pytest.raises(FitError, match="did you mean arx10B"):
        model_named("arx10b")


def test_the_command_line_names_columns_over_the_settings(tmp_path):
    path = tmp_path / "columns.yaml"
    path.write_text("input: amps\noutput: speed\ntime: t\n")
    read = reading.columns_of(path, None, "radar")
    assert (read.time, read.input, read.output) == ("t", "amps", "radar")
    plain = reading.columns_of(None, None, None)
    assert (plain.input, plain.output) == (INPUT, OUTPUT)


def test_the_period_is_what_is_said_else_the_file_s_else_5_hz():
    model = Model(0.1, 1, 1, 0, (), (0.5, 1e-4, 0.0))
    assert reading.prepared_by(None, 1.0, None).period_s == 0.2
    assert reading.prepared_by(None, 1.0, model).period_s == 0.1
    assert reading.prepared_by(0.05, 0.0, model).period_s == 0.05
    assert reading.prepared_by(0.05, 0.0, model).cutoff_hz == 0.0


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_time_is_above_zero(value):
    with pytest.raises(SettingsError, match=r"--period .*: give a time in s above 0"):
        reading.prepared_by(value, 1.0, None)
    with pytest.raises(SettingsError, match=r"--horizon"):
        reading.above_zero("--horizon", value)


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_a_cut_off_is_a_frequency_or_0(value):
    with pytest.raises(SettingsError, match=r"--cutoff .*: give a frequency in Hz, or 0"):
        reading.prepared_by(0.2, value, None)


def test_where_a_file_goes_is_made_or_refused_before_the_work(tmp_path):
    path = tmp_path / "new" / "deep" / "p.PNG"
    assert reading.destination("--picture", path, reading.PICTURES) == path
    assert path.parent.is_dir()
    with pytest.raises(SettingsError, match=r"--picture p\.txt: let the name end in \.png or \.svg or \.pdf"):
        reading.destination("--picture", type(path)("p.txt"), reading.PICTURES)
    (tmp_path / "d.png").mkdir()
    with pytest.raises(SettingsError, match="is a folder"):
        reading.destination("--picture", tmp_path / "d.png", reading.PICTURES)
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingsError, match="the folder can't be made"):
        reading.destination("--picture", tmp_path / "file" / "p.png", reading.PICTURES)


VERBS_WITH_A_PICTURE = [
    "explore x.csv",
    "orders x.csv",
    "identify x.csv",
    "compare x.csv --model arx1",
    "diagnose x.csv --model arx1",
]


@pytest.mark.parametrize("words", [*VERBS_WITH_A_PICTURE, "effects grade", "paper"])
def test_a_picture_that_can_not_be_written_is_the_option_s_fault(words, verb, tmp_path, monkeypatch):
    def full(**named: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(reading.tempfile, "TemporaryFile", full)
    code, _, err = verb(*words.split(), "--picture", tmp_path / "p.png")
    assert code == 2
    assert f"--picture {tmp_path / 'p.png'}: can't be written: No space left on device" in err


def test_notes_stand_under_their_files_and_one_thing_is_no_plural():
    time_s = 0.2 * np.arange(20)
    one = Recording(time_s, {INPUT: time_s, OUTPUT: time_s}, 0.2, "/deep/folder/a.csv", ("gap of 3 s", "1 row lost"))
    assert notes_of([one]) == ["a.csv: gap of 3 s", "a.csv: 1 row lost"]
    other = replace(one, source="b.csv", notes=("2 rows lost", "gap of 3 s"))
    assert notes_of([one, other]) == ["all recordings: gap of 3 s", "a.csv: 1 row lost", "b.csv: 2 rows lost"]
    assert [reading.count_of(n, "recording") for n in (0, 1, 2)] == ["0 recordings", "1 recording", "2 recordings"]


def test_what_is_no_file_is_said_before_anything_is_read(tmp_path):
    (tmp_path / "monday.csv").write_text("not read\n")
    with pytest.raises(RecordingError, match=r"no such file"):
        reading.tables([tmp_path / "monday.csv", tmp_path / "tuesday"], reading.columns_of(None, None, None))
    with pytest.raises(RecordingError, match=r"is a folder; name the recordings in it, as .*\*\.csv"):
        reading.tables([tmp_path / "monday.csv", tmp_path], reading.columns_of(None, None, None))
