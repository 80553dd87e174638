"""A dead time that changes is said with how early and how late the answer comes, and with its signal."""

import numpy as np
import pytest

from cruise.report.diagnosis import look_alikes, sentence
from cruise.report.diagnosis_figures import report
from cruise.validation.diagnose import Verdict, diagnose
from cruise.validation.study import study
from tests.validation.diagnosing import DT_S, PERIOD_S, PITCH, SAMPLES, SECONDS, STRUCTURE, found
from tests.validation.driving import drive


def waiting(current_ma: np.ndarray) -> np.ndarray:
    """A current that comes 0.4 s late for 25 s of every 50."""
    later = DT_S * np.arange(SAMPLES) % 50.0 < 25.0
    return np.where(later, np.concatenate([current_ma[:4], current_ma[:-4]]), current_ma)


def test_a_dead_time_that_changes_is_said_with_how_early_and_how_late_the_answer_comes():
    one = found(command=waiting)
    assert (one.verdict, one.effects, one.signals) == (Verdict.MISSING, ("transport_delay",), ())
    assert one.confidence > 0.5
    assert one.left.dead_time is not None
    assert one.left.dead_time.late_s - one.left.dead_time.early_s == pytest.approx(0.4, abs=0.15)
    assert one.worth_adding == ()
    assert not one.explained
    assert "when every command is sent" in one.next_experiment
    assert "`transport_delay` is missing: " in sentence(one)
    assert f"later ({one.left.dead_time.late_s:+.2f} s)" in sentence(one)
    assert look_alikes(one) == []
    told = report(one, "a.yaml", "arx")
    late = one.left.dead_time
    assert told["dead_time_changes"] == {
        "early_s": late.early_s,
        "late_s": late.late_s,
        "share": late.share,
        "signal": None,
    }
    assert told["worth_adding"] == []


def test_a_dead_time_that_changes_is_found_beside_another_effect():
    one = found(command=waiting, load_mps=-0.05 * PITCH)
    assert (one.verdict, set(one.effects)) == (Verdict.MISSING, {"grade", "transport_delay"})
    assert one.worth_adding == ("grade",)
    assert one.explained
    assert "`grade` and `transport_delay` are missing: with `grade` the error" in sentence(one)


def test_a_dead_time_that_changes_with_a_signal_is_one_though_the_signal_foretells_it():
    low = np.where(DT_S * np.arange(SAMPLES) % 50.0 < 25.0, 1.0, 0.0)
    columns = {"pitch_deg": PITCH, "bus_load_pct": 20.0 + 60.0 * low}
    one = diagnose(study([drive(SECONDS, 4, DT_S, 0.02, columns=columns, command=waiting)], STRUCTURE, None, PERIOD_S))
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("transport_delay",))
    assert one.left.foretold == 0.0
    assert one.left.dead_time is not None
    assert one.left.dead_time.signal == "bus_load_pct"
    assert one.next_experiment.startswith("hold everything else and move bus_load_pct")
    assert "than the model, as bus_load_pct has it" in sentence(one)


def test_a_dead_time_that_changes_with_the_signal_of_an_effect_is_that_effects_own():
    """Cold oil, and beside it a bin that fills as the oil warms, which tells the dead time as well."""
    gain = 1.0 - 0.3 * np.linspace(1.0, 0.0, SAMPLES)
    oil_c = 50.0 + 33.0 * np.log1p((1.0 - gain) / 0.3)
    late = np.arange(SAMPLES) < 0.5 * SAMPLES
    columns = {"oil_temperature_c": oil_c, "machine_mass_kg": 14_000.0 + 20.0 * oil_c}

    def cold(current_ma: np.ndarray) -> np.ndarray:
        return np.where(late, np.concatenate([current_ma[:4], current_ma[:-4]]), current_ma)

    one = diagnose(
        study([drive(SECONDS, 4, DT_S, 0.02, gain=gain, columns=columns, command=cold)], STRUCTURE, None, PERIOD_S)
    )
    assert (one.verdict, one.effects) == (Verdict.MISSING, ("oil_temperature",))
    assert one.left.dead_time is not None
    assert one.left.dead_time.signal == "oil_temperature_c"
    assert " with oil_temperature_c, too: " in sentence(one)
