"""What the service hears: the newest reading as long as it counts, and how the frames behave that bring it."""

import math
from random import Random

import numpy as np
import pytest

from cruise.sampling import SamplingSettings
from cruise.service.hearing import RADAR, Hearing
from cruise.signals import Reading
from tests.service.drive import codec

FRAME_S = 0.05


def hearing() -> Hearing:
    return Hearing(codec(), SamplingSettings(), FRAME_S)


def test_a_reading_counts_until_the_tick_before_it_is_stale():
    ears = hearing()
    ears.take(codec().encode("EEC1", {"engine_speed_rpm": 2000.0}, 1.0))
    assert ears.value("engine_speed_rpm", 1.25) == 2000.0
    assert math.isnan(ears.value("engine_speed_rpm", 1.26))  # the next tick would be 0.31 s after the reading
    assert math.isnan(ears.value("gear", 1.0))


def test_the_radars_speed_is_not_the_drives():
    ears = hearing()
    kept = ears.take(codec().encode("GBSD", {"ground_speed_mps": 1.3}, 1.0))
    assert "ground_speed_mps" not in {reading.name for reading in kept}
    assert math.isnan(ears.value("ground_speed_mps", 1.0))
    assert ears.value(RADAR, 1.0) == pytest.approx(1.3)


def test_what_is_ignored_is_not_taken_in():
    ears = hearing()
    frame = codec().encode("MachineSelectedSpeedCommand", {"setpoint_mps": 1.3}, 1.0)
    assert "setpoint_mps" not in {reading.name for reading in ears.take(frame, ("setpoint_mps",))}
    assert math.isnan(ears.value("setpoint_mps", 1.0))


def test_our_own_messages_from_elsewhere_are_counted_and_damaged_ones_are_not():
    ears = hearing()
    frame = codec().encode("PumpCurrentCommand", {"pump_current_command_ma": 1.0, "command_active": 1.0}, 1.0)
    frame.data[3] ^= 1
    ears.take(frame)
    assert ears.imposters == 0
    ears.take(codec().encode("MachineSelectedSpeed", {"machine_selected_speed_mps": 1.0}, 1.0))
    assert ears.imposters == 1


def test_the_share_of_faulty_frames_is_that_of_the_last_ten():
    ears, sender = hearing(), codec()
    for k in range(30):
        frame = sender.encode("DriveFeedback", {"ground_speed_mps": 1.0, "pump_current_ma": 1.0}, 0.02 * k)
        if k in (10, 11):
            frame.data[3] ^= 1
        ears.take(frame)
        assert ears.faulty_share(0.02 * k) == pytest.approx(0.1 * sum(1 for bad in (10, 11) if bad <= k < bad + 10))


def test_damaged_frames_of_a_message_that_comes_no_more_are_forgotten():
    ears, sender = hearing(), codec()
    for k in range(8):
        frame = sender.encode("CommissioningRequest", {"requested_experiment": 0.0}, 1.0 + 0.01 * k)
        frame.data[0] ^= 0x55
        ears.take(frame)
    assert ears.faulty_share(1.1) == 0.8
    assert ears.faulty_share(5.9) == 0.8
    assert ears.faulty_share(6.1) == 0.0


def test_a_second_sender_shows_in_the_rate_and_a_late_burst_does_not():
    def heard(times_s: list[float]) -> Hearing:
        ears, sender = hearing(), codec()
        for k in range(20):
            ears.take(sender.encode("ETC2", {"gear": 2.0}, 0.1 * k))
        ears.compare(1.9, driving=True)
        for time_s in times_s:
            ears.take(sender.encode("ETC2", {"gear": 2.0}, time_s))
        return ears

    steady = [2.0 + 0.1 * k for k in range(20)]
    ears = heard(steady)
    for _ in range(2):  # to look later changes nothing
        assert 0.8 < ears.crowding(3.9) <= 1.0
        assert ears.crowding(9.0) == 0.0
    assert heard(sorted(steady + [time_s + 0.01 for time_s in steady])).crowding(3.95) > 1.6
    assert heard([max(time_s, 2.3) for time_s in steady[:9]]).crowding(2.8) < 1.6
    assert math.isnan(hearing().crowding(1.0))


@pytest.mark.parametrize(
    ("words", "times"),
    [
        ([1.0] * 8, 0),
        ([1.0, 1.1, 1.2, 1.3, 1.2, 1.1, 1.0], 1),  # there and back
        ([1.0, 1.001] * 4, 0),  # a knob between two of its steps
        ([1.0, 2.0] * 4, 6),
        ([1.0, math.nan] * 4, 0),
    ],
)
def test_a_setpoint_that_goes_back_and_forth_is_counted(words, times):
    ears, canopen, sender = hearing(), hearing(), codec()
    for k, word in enumerate(words):
        ears.take(sender.encode("MachineSelectedSpeedCommand", {"setpoint_mps": word}, 0.1 * k))
        canopen.take_word(Reading("setpoint_mps", 0.1 * k, word))
    for _ in range(2):  # to look later changes nothing
        assert ears.wavering(0.1 * len(words)) == canopen.wavering(0.1 * len(words)) == times
        assert ears.wavering(5.0) == 0


@pytest.mark.parametrize("button", ["cruise_set", "cruise_resume"])
def test_one_frame_alone_neither_presses_nor_lets_go_a_button_that_engages(button):
    ears, heard = hearing(), []
    for number, pressed in enumerate((0, 0, 1, 0, 1, 1, 0, 1, 1, 0, 0)):
        now_s = 1.0 + 0.1 * number
        ears.take(codec().encode("CCVS", {button: float(pressed), "brake_pedal": float(pressed)}, now_s))
        heard.append(ears.value(button, now_s))
        assert ears.value("brake_pedal", now_s) == pressed  # what ends it acts at once
    assert heard[1:] == [0, 0, 0, 0, 1, 1, 1, 1, 1, 0]


@pytest.mark.parametrize("button", ["cruise_set", "cruise_resume"])
def test_a_button_that_is_held_at_first_or_after_silence_is_unknown_until_two_frames_agree(button):
    ears, heard = hearing(), []
    for now_s in (1.0, 1.1, 1.2, 1.6, 1.7, 1.8):
        ears.take(codec().encode("CCVS", {button: 1.0}, now_s))
        heard.append(ears.value(button, now_s))
    np.testing.assert_array_equal(heard, [math.nan, 1.0, 1.0, math.nan, 1.0, 1.0])  # it was never seen released


@pytest.mark.parametrize("frames", [1, 2, 3, 7])
@pytest.mark.parametrize("before_s", [(), tuple(0.1 * k for k in range(20)), tuple(2.6 + 0.1 * k for k in range(4))])
def test_a_sender_that_has_just_come_is_compared_once_it_was_heard_for_a_second(before_s, frames):
    """So many frames until the controller takes over, and then as ever; from 8 s on somebody else sends, too."""
    ears, sender = hearing(), codec()
    taken_over_s = 3.4 + 0.1 * frames
    times_s = [*before_s, *(3.4 + 0.1 * k for k in range(80)), *(8.03 + 0.1 * k for k in range(30))]
    for time_s in sorted(times_s):
        ears.take(sender.encode("CCVS", {"cruise_set": 0.0}, time_s))
        ears.compare(time_s, driving=time_s > taken_over_s - 0.15)
        if time_s < 4.3:
            assert math.isnan(ears.crowding(time_s))
        elif time_s < 8.0:
            assert ears.crowding(time_s) < 1.2 or math.isnan(ears.crowding(time_s))
    assert ears.crowding(9.5) > 1.6


@pytest.mark.parametrize("period_s", [0.5, 1.0, 2.0])
def test_a_slow_message_that_comes_a_little_early_or_late_is_no_second_sender(period_s):
    ears, sender, rng = hearing(), codec(), Random(1)
    times_s = [period_s * k + rng.uniform(0.0, 0.05) for k in range(60)]
    for k in range(round(55.0 * period_s / FRAME_S)):
        while times_s[0] <= FRAME_S * k:
            ears.take(sender.encode("VF", {"oil_temperature_c": 50.0}, times_s.pop(0)))
        ears.compare(FRAME_S * k, driving=True)
        assert not ears.crowding(FRAME_S * k) > 1.0


def test_while_a_person_drives_nothing_is_compared_and_the_next_drive_begins_anew():
    ears, sender = hearing(), codec()
    for k in range(80):
        ears.take(sender.encode("ETC2", {"gear": 2.0}, (0.1 if k < 20 else 0.05) * k))
        ears.compare((0.1 if k < 20 else 0.05) * k, driving=not 20 <= k < 50)
    assert ears.crowding(4.0) <= 1.05
    ears.compare(4.0, driving=False)
    assert math.isnan(ears.crowding(4.0))


def test_a_button_that_stays_unknown_is_unknown():
    ears = hearing()
    for number, pressed in enumerate((1.0, 1.0, math.nan, math.nan)):
        ears.take(codec().encode("CCVS", {"cruise_set": pressed}, 1.0 + 0.1 * number))
        assert math.isnan(ears.value("cruise_set", 1.0 + 0.1 * number)) == (number in (0, 3))


def test_frames_of_the_drive_that_come_again_are_heard_whatever_their_counters_say():
    """Eleven frames in a circle: the counter jumps once in a round; 1.2 s of other frames before."""
    ears, voice, rng = hearing(), codec(), Random(1)
    for k in range(60):
        ears.take(voice.encode("DriveFeedback", spoken(rng), 0.02 * k))
    assert ears.playback.repeated < 3
    circle = [voice.encode("DriveFeedback", spoken(rng), 1.2 + 0.02 * k) for k in range(11)]
    for _ in range(4):
        for frame in circle:
            ears.take(frame)
    assert ears.playback.repeated > 24
    assert ears.faulty_share(2.1) < 0.3
    ears.take(voice.encode("DriveFeedback", spoken(rng), 2.1))
    assert ears.playback.repeated == 0


def spoken(rng: Random) -> dict[str, float]:
    """What the drive says, with its noise."""
    return {"ground_speed_mps": rng.gauss(1.5, 0.015), "pump_current_ma": rng.gauss(800.0, 1.0)}
