"""tools/bench identification and recovery: on a very short run, without the peers that need the network."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from cruise.identification.structures import PRESETS
from tools.benchmarks import identification, peers, recovery
from tools.benchmarks.__main__ import PARTS

SHORT = 3000  # samples


@pytest.fixture
def short(monkeypatch):
    """Fewer samples and turns."""
    for name, value in (("SAMPLES", SHORT), ("PART", SHORT), ("TURNS", 2), ("FEW_TURNS", 1)):
        monkeypatch.setattr(identification, name, value)


def test_both_are_parts_of_the_bench():
    assert PARTS["identification"] is identification.measure
    assert PARTS["recovery"] is recovery.measure


def test_it_times_every_fit_and_says_who_was_left_out(short, monkeypatch):
    monkeypatch.delenv(identification.DATA, raising=False)
    found = identification.measure(peers=False)
    json.dumps(found.as_json(), allow_nan=False)
    figures = {figure.key: figure for figure in found.figures}
    assert set(figures) == {"arx_over_numpy", "numpy_ms", "arx_ms", "ahead_ms", "armax_ms", "output_error_ms"}
    assert all(figure.value > 0.0 for figure in found.figures)
    assert {key for key, figure in figures.items() if figure.target} == {"arx_over_numpy", "ahead_ms"}
    assert found.notes[0] == "SysIdentPy and SIPPY were left out"
    assert "CRUISE_DATA is not set" in found.notes[1]


class Others:
    """Peers that find what numpy finds, in 1000 s: longer than any machine takes for the short recording."""

    def __init__(self, one, shift: float = 0.0) -> None:
        theta = identification.bare(one)
        theta[0] += shift
        self.found = {"sysidentpy_arx": theta, "sippy_arx": theta, "sippy_armax": np.append(theta, 0.0)}

    def __enter__(self) -> "Others":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def fit(self, name: str) -> peers.Timed:
        return peers.Timed(1000.0, tuple(self.found[name].tolist()))


def test_peers_are_compared_by_their_time_and_their_error(short, monkeypatch):
    monkeypatch.delenv(identification.DATA, raising=False)
    monkeypatch.setattr(identification.Peers, "start", lambda *data: Others(identification.system()))
    figures = {figure.key: figure for figure in identification.measure().figures}
    for name in ("sysidentpy_over_numpy", "sippy_over_numpy"):
        assert figures[name].value > 1000.0
        assert not figures[name].target
    assert figures["armax_faster_than_sippy"].at_least == 5.0
    assert figures["armax_faster_than_sippy"].value > 100.0
    assert 0.5 < figures["armax_error_over_sippy"].value < 0.98, "least squares leaves coloured residuals"


def test_a_peer_that_solves_another_problem_is_not_timed(short, monkeypatch):
    monkeypatch.setattr(identification.Peers, "start", lambda *data: Others(identification.system(), 0.01))
    with pytest.raises(RuntimeError, match="sysidentpy_arx solves another problem"):
        identification.measure()


def test_peers_that_can_not_be_installed_are_a_note(monkeypatch, tmp_path):
    monkeypatch.setattr(peers, "HOME", tmp_path / "venv")
    monkeypatch.setattr(peers, "REQUIRED", ("no such requirement",))
    monkeypatch.setattr(peers.sys, "executable", str(tmp_path / "no_python"))
    said = peers.Peers.start(np.zeros(3), np.zeros(3))
    assert isinstance(said, str)
    assert said.startswith("SysIdentPy and SIPPY are not installed: ")


def test_the_innovation_of_the_truth_is_its_noise():
    one = identification.system()
    truth = (1.2, -0.35, 3e-4, 2e-4, 0.0, 0.6)
    assert identification.innovation_mps(one, truth) == pytest.approx(0.03, rel=0.02)
    assert identification.innovation_mps(one, truth[:-1]) > 1.1 * 0.03


def test_medians_are_of_calls_in_turns():
    order, times = [], iter([3.0, 1.0, 2.0])

    def theirs() -> float:
        order.append("theirs")
        return next(times)

    def ours() -> None:
        order.append("ours")

    mine_s, told_s = identification.medians_s([ours, theirs], 3)
    assert order == ["ours", "theirs"] * 3
    assert told_s == 2.0
    assert 0.0 <= mine_s < 0.1


def test_the_table_of_models_on_measured_drives(dart: Path):
    figures, words = identification.dart(("arx10", "arx7"))
    values = {figure.key: figure.value for figure in figures}
    assert set(values) == {f"dart_{n}_{u}" for n in ("persistence", "arx10", "arx7") for u in ("mps", "explained_pct")}
    assert values["dart_arx10_mps"] < 0.4 * values["dart_persistence_mps"]
    assert "20 files fitted to, 19 judged" in words[0]


def test_an_unstable_model_has_no_number_in_the_table(monkeypatch, dart: Path):
    monkeypatch.setattr("cruise.identification.families.why_unstable", lambda poles: "pole at 1.1")
    figures, _ = identification.dart(("arx10",))
    unstable = [figure for figure in figures if "arx10" in figure.key]
    assert all(math.isnan(figure.value) for figure in unstable)
    assert "arx10" in PRESETS


def test_recovery_reports_every_system(monkeypatch):
    monkeypatch.setattr(recovery, "SYSTEMS", {"arx": recovery.SYSTEMS["arx"]})
    found = {figure.key: figure for figure in recovery.measure(range(4)).figures}
    assert set(found) == {"arx_within", "arx_ratio_least", "arx_ratio_most", "arx_converged"}
    assert (found["arx_within"].at_least, found["arx_ratio_least"].at_least, found["arx_ratio_most"].at_most) == (
        0.95,
        0.8,
        1.2,
    )
