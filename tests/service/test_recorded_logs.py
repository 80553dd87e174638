"""The known drive in a log of frames comes back as itself, with what was taken online, and nothing lost in silence."""

import numpy as np
import pytest

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.log import LogError
from cruise.can.settings import CanSettings
from cruise.csv_file import write_csv
from cruise.recording import RecordingError
from cruise.sampling import SamplingSettings, StreamSampler
from cruise.service.recordings import ReadingSettings, frames_of_log, read_recording
from cruise.signals import INPUT, OUTPUT
from tests.service.logs import BY_DBC, DBC, START_S, STEP_S, assert_is_the_drive, drive, logged, speed_mps


@pytest.mark.parametrize("ending", [".log", ".log.gz", ".asc", ".blf", ".trc", ".db", ".mf4"])
def test_a_log_in_any_format_is_the_drive(tmp_path, ending):
    read = read_recording(logged(tmp_path / f"drive{ending}", drive()), BY_DBC)
    assert_is_the_drive(read, 2e-3)
    assert set(read.columns) == {INPUT, OUTPUT, "gear", "pitch_deg"}
    assert (read.columns["gear"][:-1] == 2.0).all()
    # five times as fast as the rest: the mean around the instant, so that nothing is shifted
    np.testing.assert_allclose(read.columns["pitch_deg"][2:-2], read.time_s[2:-2], atol=0.006)
    assert read.notes == ("second sources of a signal, left out unless named: GBSD.ground_speed_mps",)


def test_a_log_goes_onto_a_coarser_grid_as_means(tmp_path):
    path = logged(tmp_path / "drive.log", drive())
    read = read_recording(path, BY_DBC, 0.2)
    assert read.dt_s == 0.2
    np.testing.assert_allclose(read.output, speed_mps(read.time_s - 0.1), atol=2e-3)
    np.testing.assert_allclose(read.columns["pitch_deg"], read.time_s - 0.1, atol=2e-3)


def test_the_samples_of_a_log_are_those_that_are_taken_online(tmp_path):
    frames = drive()
    for frame in frames:
        frame.timestamp += 0.013
    path, codec = logged(tmp_path / "drive.log", frames), Codec.load(DBC, CanSettings())
    sampler, online = StreamSampler(SamplingSettings()), []
    for frame in frames_of_log(path, []):
        while (until_s := 0.013 + 0.2 * (len(online) + 1)) < frame.timestamp - 1e-5:
            online.append(sampler.sample(until_s + 1e-6, 0.2))
        decoded = codec.decode(frame)
        for one in decoded.readings:
            if one.name != OUTPUT or decoded.message == "DriveFeedback":
                sampler.push(one.name, one.time_s, one.value)
    read = read_recording(path, BY_DBC, 0.2)
    assert len(read) == len(online) == 20
    for name, values in read.columns.items():
        np.testing.assert_allclose(values, [sample[name] for sample in online], atol=1e-3)


def test_times_of_a_log_start_at_zero_and_are_kept_as_they_were(tmp_path):
    read = read_recording(logged(tmp_path / "drive.log", drive()), BY_DBC)
    assert read.time_s[0] == 0.0
    assert read.stamps_s is not None
    np.testing.assert_allclose(read.stamps_s, STEP_S * np.arange(81), atol=1e-6)


def test_a_second_source_is_there_for_whoever_asks(tmp_path):
    path = logged(tmp_path / "drive.log", drive())
    asked = ReadingSettings(database=str(DBC), output="GBSD.ground_speed_mps")
    read = read_recording(path, asked)
    assert read.dt_s == pytest.approx(0.1)
    np.testing.assert_allclose(read.output, speed_mps(read.time_s) + 0.5, atol=2e-3)
    # twice as fast, so a mean, whose last part is held as online: a quarter of its own step late at most
    np.testing.assert_allclose(read.columns["recorded_ground_speed_mps"], speed_mps(read.time_s), atol=0.011)
    only = read_recording(logged(tmp_path / "radar.log", radar_only()), BY_DBC)
    np.testing.assert_allclose(only.output, speed_mps(only.time_s) + 0.5, atol=2e-3)


def test_the_drives_own_speed_counts_however_seldom_it_comes(tmp_path):
    codec = Codec.load(DBC, CanSettings())
    frames = drive(without=["GBSD"])
    frames += [codec.encode("GBSD", {OUTPUT: 5.0}, START_S + 0.01 * k) for k in range(401)]
    frames.sort(key=lambda frame: frame.timestamp)
    assert_is_the_drive(read_recording(logged(tmp_path / "drive.log", frames), BY_DBC), 2e-3)


def radar_only() -> list[Frame]:
    """A log in which the drive's own message has a current and never a speed."""
    codec = Codec.load(DBC, CanSettings())
    frames = drive(without=["DriveFeedback"])
    frames += [codec.encode("DriveFeedback", {INPUT: 700.0}, START_S + k * STEP_S) for k in range(81)]
    return sorted(frames, key=lambda frame: frame.timestamp)


def test_of_several_buses_that_of_the_drive_counts_and_the_others_with_what_it_has_not(tmp_path):
    codec, wheel = Codec.load(DBC, CanSettings()), {"wheel_speed_mps": 5.0}
    codec.encode("DriveFeedback", {}, 0.0)  # another machine's, its counter ahead of the drive's
    foreign = []
    for k in range(81):
        t = START_S + k * STEP_S + 0.01
        foreign += [codec.encode("DriveFeedback", {OUTPUT: 9.0, INPUT: 100.0}, t), codec.encode("WBSD", wheel, t)]
        foreign += [codec.encode("EEC1", {"engine_speed_rpm": 2000.0}, t)]
    own = [*drive(), *(codec.encode("WBSD", {"wheel_speed_mps": 1.0}, START_S + k * STEP_S) for k in range(81))]
    for frames, channel in ((own, "can0"), (foreign, "can1")):
        for frame in frames:
            frame.channel = channel
    frames = sorted([*own, *foreign], key=lambda frame: frame.timestamp)
    read = read_recording(logged(tmp_path / "drive.log", frames), BY_DBC)
    assert_is_the_drive(read, 2e-3)
    assert set(read.columns["wheel_speed_mps"].tolist()) == {1.0}
    assert set(read.columns["engine_speed_rpm"][1:].tolist()) == {2000.0}
    (note,) = (note for note in read.notes if "buses" in note)
    assert "on channel can0 first; of can1 are taken: EEC1.engine_speed_rpm; left out, there already: Drive" in note
    assert not any("counter" in note for note in read.notes)


def test_input_and_output_may_come_from_two_buses(tmp_path):
    codec = Codec.load(DBC, CanSettings())
    currents = [codec.encode("DriveFeedback", {INPUT: 700.0 + k}, START_S + k * STEP_S) for k in range(81)]
    for frame in currents:
        frame.channel = "can1"
    frames = sorted([*drive(without=["DriveFeedback"]), *currents], key=lambda frame: frame.timestamp)
    read = read_recording(logged(tmp_path / "drive.log", frames), BY_DBC, STEP_S)
    np.testing.assert_allclose(read.input, 700.0 + np.arange(81), atol=0.03)
    np.testing.assert_allclose(read.output, speed_mps(read.time_s) + 0.5, atol=2e-3)


def test_the_command_stands_in_for_a_current_that_nobody_measured(tmp_path):
    codec = Codec.load(DBC, CanSettings())
    commands = []
    for k in range(81):
        values = {"pump_current_command_ma": 500.0 + k, "command_active": float(k >= 40)}
        commands.append(codec.encode("PumpCurrentCommand", values, START_S + k * STEP_S))
    frames = sorted([*drive(without=["DriveFeedback"]), *commands], key=lambda frame: frame.timestamp)
    read = read_recording(logged(tmp_path / "a.log", frames), BY_DBC, STEP_S)
    assert any("no measured current in the log" in note for note in read.notes)
    at = int(np.argmax(np.isfinite(read.input)))
    assert read.time_s[at] == pytest.approx(40 * STEP_S)
    assert read.input[at] == pytest.approx(540.0, abs=0.03)
    both = sorted([*drive(), *commands], key=lambda frame: frame.timestamp)
    measured = read_recording(logged(tmp_path / "b.log", both), BY_DBC)
    assert measured.input[10] == 700.0  # the measured one where there is one
    assert measured.columns["pump_current_command_ma"][10] == pytest.approx(510.0, abs=0.03)


def test_nothing_is_lost_in_silence(tmp_path):
    frames = drive(8.0)
    feedback = [frame for frame in frames if frame.arbitration_id & 0x00FFFF00 == 0x00FF1000]
    feedback[10].data[3] ^= 0xFF
    for frame in feedback[80:120]:
        frame.arbitration_id ^= 0x0F  # another sender
    frames.insert(70, Frame(arbitration_id=0x123, is_extended_id=False, timestamp=frames[70].timestamp))
    frames.insert(71, Frame(is_error_frame=True, timestamp=frames[71].timestamp))
    late = Codec.load(DBC, CanSettings()).encode("ETC2", {"gear": 1.0}, frames[300].timestamp - 0.5)
    frames.insert(300, late)
    read = read_recording(logged(tmp_path / "drive.log", frames), BY_DBC)
    notes = read.notes
    assert "1 frames: error frame" in notes
    assert "DriveFeedback: 1 frames dropped, bad crc" in notes
    assert "DriveFeedback: 40 frames dropped, wrong source" in notes
    assert "DriveFeedback: 1 frames taken though some before them are missing, counter jumped" in notes
    assert "1 frames of identifiers that the database does not describe: 0x123 (1)" in notes
    assert any(note.startswith("gear: 1 of ") and "out of order" in note for note in notes)
    assert any(note.startswith("ground_speed_mps: gap of 2.05 s at t=3.95 s") for note in notes)
    assert np.isnan(read.output[(read.time_s > 4.0) & (read.time_s < 6.0)]).all()
    assert (read.columns["gear"][:-1] == 2.0).all()


def test_a_logger_that_keeps_every_fifth_frame_keeps_readings(tmp_path):
    frames = drive(8.0)
    feedback = [frame for frame in frames if frame.arbitration_id & 0x00FFFF00 == 0x00FF1000]
    frames = [frame for frame in frames if frame not in feedback or frame in feedback[::5]]
    repeated = Frame(arbitration_id=feedback[5].arbitration_id, data=feedback[5].data, timestamp=START_S + 0.3)
    frames = sorted([*frames, repeated], key=lambda frame: frame.timestamp)
    read = read_recording(logged(tmp_path / "drive.log", frames), BY_DBC)
    assert read.dt_s == pytest.approx(5 * STEP_S)
    np.testing.assert_allclose(read.output, speed_mps(read.time_s), atol=2e-3)
    assert "DriveFeedback: 32 frames taken though some before them are missing, counter jumped" in read.notes
    assert "DriveFeedback: 1 frames dropped, counter repeated" in read.notes


def test_a_clock_that_was_set_is_a_pause(tmp_path):
    frames = drive(8.0)
    for frame in frames[len(frames) // 2 :]:
        frame.timestamp -= 3600.0
    read = read_recording(logged(tmp_path / "drive.log", frames), BY_DBC)
    assert "taken as a pause of 5 s" in read.notes[0]
    assert read.time_s[-1] == pytest.approx(13.0, abs=0.1)


@pytest.mark.parametrize("ending", [".log", ".log.gz", ".asc", ".asc.gz", ".blf"])
def test_a_log_that_the_power_cut_short_is_read_up_to_there_and_it_is_said(tmp_path, ending):
    path = logged(tmp_path / f"drive{ending}", drive(8.0))
    path.write_bytes(path.read_bytes()[: int(0.7 * path.stat().st_size)])
    read = read_recording(path, BY_DBC)
    np.testing.assert_allclose(read.output, speed_mps(read.time_s - read.time_s[0]), atol=2e-3)
    assert 2.0 < read.time_s[-1] < 7.5
    assert any(note.startswith("ends broken at t=") for note in read.notes)


def test_a_log_that_breaks_before_its_end_or_at_once_is_refused(tmp_path):
    lines = logged(tmp_path / "drive.log", drive()).read_text().splitlines()
    (tmp_path / "middle.log").write_text("\n".join([*lines[:300], lines[300][:20], *lines[301:]]))
    with pytest.raises(LogError, match=r"middle\.log:301: cannot be read"):
        read_recording(tmp_path / "middle.log", BY_DBC)
    (tmp_path / "first.log").write_text(lines[0][:20])
    with pytest.raises(LogError, match=r"first\.log:1: cannot be read"):
        read_recording(tmp_path / "first.log", BY_DBC)


def test_too_few_frames_are_too_few(tmp_path):
    path = logged(tmp_path / "drive.log", drive(0.3))
    with pytest.raises(RecordingError, match="pump_current_ma has 7 readings, too few"):
        read_recording(path, BY_DBC)


def test_what_is_written_as_csv_is_what_the_log_said(tmp_path):
    read = read_recording(logged(tmp_path / "drive.log", drive()), BY_DBC)
    write_csv(read, tmp_path / "drive.csv")
    again = read_recording(tmp_path / "drive.csv", BY_DBC)
    for name, values in read.columns.items():
        np.testing.assert_allclose(again.columns[name], values, atol=1e-9)
