"""tools/bench missing: the cases are what they say, the general methods are run right, times are a process's own."""

import json
import math
import os

import numpy as np
import pytest

from cruise.identification.structures import parse
from cruise.signals import INPUT, OUTPUT
from cruise.validation import study as studies
from tools.benchmarks import diagnosis_time, missing, missing_peers
from tools.benchmarks.__main__ import PARTS
from tools.benchmarks.diagnosis_time import Diagnosed
from tools.benchmarks.missing_peers import HORIZON, Polynomial, Samples
from tools.benchmarks.peers import HOME, REQUIRED
from tools.trial import course, machine
from tools.trial.sizing import MODEL
from tools.trial.trial import SECONDS


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings of 5 minutes."""
    monkeypatch.setitem(SECONDS, "clean", 300.0)


def base_of(recordings) -> Diagnosed:
    """A diagnosis that finds nothing, at once."""
    study = studies.study(recordings, parse(MODEL), None, 0.2)
    return Diagnosed("nothing", (), study.base.explanation, 2.0, 3.0, 100.0)


def test_another_day_is_another_course_of_the_same_machine():
    first, second = (missing.Drive(tier="clean", seed=4, day=day) for day in (0, 1))
    courses = [course.draw(one) for one in (first, second)]
    machines = [machine.base(one, drawn) for one, drawn in zip((first, second), courses, strict=True)]
    assert machines[0].settings == machines[1].settings
    assert not np.allclose(courses[0].current_ma, courses[1].current_ma)
    assert missing.Drive(tier="clean", seed=4, times=3).seconds == 3.0 * SECONDS["clean"]


def test_what_teaches_outside_lies_within_and_what_judges_beyond(short):
    first, second = missing.drive("rolling_resistance"), missing.drive("rolling_resistance", day=1)
    stretches, beyond = missing.outside(first, second, "machine_mass_kg")
    taught = np.concatenate([one.columns["machine_mass_kg"] for one in stretches])
    whole, unseen = first.columns["machine_mass_kg"], second.columns["machine_mass_kg"][4::4]
    assert np.ptp(taught) < 0.9 * np.ptp(whole)
    assert 0.45 * len(whole) < len(taught) < 0.65 * len(whole)
    assert len(beyond) == len(unseen)
    jitter_kg = 800.0  # the bin loses 240 kg/s when it is emptied; the mean over 5 s is half of that late
    assert not ((unseen[beyond] > taught.min() + jitter_kg) & (unseen[beyond] < taught.max() - jitter_kg)).any()
    assert unseen[~beyond].min() > taught.min() - jitter_kg


def test_every_figure_is_there_without_the_peers(short, monkeypatch):
    monkeypatch.setattr(missing, "diagnosed", base_of)
    assert PARTS["missing"] is missing.measure
    found = missing.measure(("rolling_resistance",), peers=False, times=1)
    json.dumps(found.as_json(), allow_nan=False)
    figures = {figure.key: figure.value for figure in found.figures}
    assert all(math.isfinite(value) for value in figures.values())
    for where in ("inside", "outside"):
        assert figures[f"named_{where}"] == 0.0
        assert figures[f"found_over_true_{where}"] == figures[f"base_over_true_{where}"] > 1.2
        assert figures[f"true_20hz_over_floor_{where}"] > 0.95
    assert figures["boosting_over_floor_inside"] < figures["base_over_floor_inside"]
    assert figures["long_ratio"] == 1.0
    assert found.notes[1] == "SysIdentPy and PySINDy were left out"
    assert "rolling_resistance, outside" in found.notes[3]


def test_the_floor_is_the_noise_of_means():
    rng = np.random.default_rng(0)
    noise = rng.normal(0.0, 0.01, 400_001)
    means = np.add.reduceat(0.5 * (noise[:-1] + noise[1:]), np.arange(0, 400_000, 4)) / 4.0
    assert pytest.approx(means.std(), rel=0.01) == missing.FLOOR_MPS


def made_up(seed: int, count: int = 2400) -> Samples:
    """y_k = 0.8 y_(k-1) + 0.2 u_(k-3) + 0.1 u_(k-3) s_k, without noise; the base model knows nothing of s."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(0.0, 1.0, count), 5)[:count]
    signal = np.repeat(rng.uniform(-1.0, 1.0, count), 20)[:count]
    speed, base = np.zeros(count), np.zeros(count)
    for k in range(3, count):
        speed[k] = 0.8 * speed[k - 1] + 0.2 * current[k - 3] + 0.1 * current[k - 3] * signal[k]
        base[k] = 0.8 * base[k - 1] + 0.2 * current[k - 3]
    return Samples(current, speed, signal[None, :], base)


def test_a_polynomial_runs_on_its_own_speeds():
    one = made_up(0)
    # Columns: y_(k-1), u_k .. u_(k-3), s_k, 1.
    pairs, coefficients = np.array([[0, 6], [4, 6], [4, 5]]), np.array([0.8, 0.2, 0.1])
    true = Polynomial(1, 3, np.zeros(6), np.ones(6), pairs, coefficients)
    predicted = true.ahead(one)
    np.testing.assert_allclose(predicted[HORIZON + 3 :], one.speed_mps[HORIZON + 3 :], atol=1e-12)
    assert np.isnan(predicted[:HORIZON]).all()
    hole = one.speed_mps.copy()
    hole[1000:] += 1.0
    later = true.ahead(Samples(one.current_ma, hole, one.signals, one.base_mps))
    np.testing.assert_array_equal(later[: 1000 + HORIZON], predicted[: 1000 + HORIZON])
    assert later[1000 + HORIZON] == pytest.approx(predicted[1000 + HORIZON] + 0.8**HORIZON)


def test_boosting_learns_what_the_base_lacks_and_sees_no_speed_on_the_way():
    train, test = made_up(0), made_up(1)
    predicted = missing_peers.boosting(train, test).predicted_mps
    where = slice(100, None)
    assert np.std((test.speed_mps - predicted)[where]) < 0.5 * np.std((test.speed_mps - test.base_mps)[where])
    other = test.speed_mps.copy()
    other[1500:] += 1.0
    again = missing_peers.boosting(train, Samples(test.current_ma, other, test.signals, test.base_mps)).predicted_mps
    np.testing.assert_array_equal(again[: 1500 + HORIZON], predicted[: 1500 + HORIZON])
    assert not np.array_equal(again, predicted)


def test_the_peers_find_a_system_of_their_own_kind():
    stamp = HOME / "installed"
    if not (stamp.is_file() and stamp.read_text() == " ".join(REQUIRED)):
        pytest.skip("the peers are not installed; tools/bench missing does that")
    test = made_up(1)
    answers = missing_peers.ask([(made_up(0), test)])
    assert not isinstance(answers, str)
    for answer in answers[0].values():
        np.testing.assert_allclose(answer.predicted_mps[50:], test.speed_mps[50:], atol=0.01)


def test_a_diagnosis_has_its_own_memory(monkeypatch):
    monkeypatch.setitem(SECONDS, "clean", 120.0)
    weight = np.ones(80_000_000)  # 640 MB of this process
    found = diagnosis_time.diagnosed([missing.drive("dead_zone")])
    assert found.verdict in ("missing", "nothing", "unlisted", "ambiguous")
    assert 50.0 < found.peak_mb < 0.5e-6 * weight.nbytes
    assert 0.0 < found.cpu_s < 1.2 * len(os.sched_getaffinity(0)) * found.wall_s


def test_times_are_held_against_their_targets(short):
    one = base_of([missing.drive("dead_zone")])
    ordinary = [Diagnosed("nothing", (), one.final, cpu_s, cpu_s, 500.0) for cpu_s in (4.0, 8.0, 21.0)]
    long = Diagnosed("nothing", (), one.final, 50.0, 60.0, 1200.0)
    found = {figure.key: figure for figure in diagnosis_time.figures(ordinary, long, ordinary[0])}
    assert found["wall_median_s"].value == found["cpu_median_s"].value == 8.0
    assert found["long_ratio"].value == 12.5
    missed = {key for key, figure in found.items() if figure.missed}
    assert missed == {"wall_worst_s", "long_ratio", "long_peak_mb"}


def test_signals_that_give_the_speed_away_are_no_causes():
    assert not {INPUT, OUTPUT, "wheel_speed_mps", "engine_load_pct", "line_pressure_bar"} & set(missing.CAUSES)
