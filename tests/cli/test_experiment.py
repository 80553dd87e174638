"""`cruise experiment` as a user meets it: the list, a drive with its recording, and every refusal."""

import re
from pathlib import Path

import msgspec
import pytest
import typer
from typer.testing import CliRunner, Result

from cruise.can.bus import Bus, Sent
from cruise.can.frame import Frame
from cruise.cli import experiment as verb
from cruise.cli.places import CONFIG
from cruise.columns import RecordingSettings
from cruise.csv_file import read_csv
from cruise.service.operator_node import OperatorNode
from cruise.settings import SettingsError
from tests.service.drive import codec
from tests.service.test_experiments import NOISE, Whole

APP = typer.Typer()
APP.command()(verb.experiment)
SHORT = ("--seconds", "3")


def run(*words: object) -> Result:
    """One command line; an error of the user is raised here as main() would show it."""
    result = CliRunner().invoke(APP, [str(word) for word in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def test_the_list_names_every_experiment_with_its_duration():
    result = run("--list")
    assert result.exit_code == 0
    rows = {cells[1]: cells for line in result.stdout.splitlines() if len(cells := line.split()) > 1}
    first = " ".join(rows["white_noise_short"])
    assert first.startswith("3 white_noise_short white")
    assert first.endswith("450-1050 2 75 s 3 m/s")
    assert rows["steps_gear_4"][-4:] == ["159", "s", "8.5", "m/s"]
    assert {"ramp", "multisine", "steps"} <= rows.keys()


def test_a_drive_leaves_a_recording_and_says_what_to_do_next(tmp_path: Path):
    path = tmp_path / "new" / "noise.csv"
    result = run(
        "white_noise_short", *SHORT, "--out", path, "--mass", 17200, "--slope", -3.5, "--gear", 1, "--rpm", 1900
    )
    assert result.exit_code == 0, result.output
    said = result.stdout
    assert "white_noise_short, gear 1, 17200 kg, -3.5 deg, 1900 rpm, seed 3" in said
    assert f"60 samples at 20 Hz, 3.0 s, in {path}" in said
    assert f"next: cruise explore {path}" in said
    assert f"cruise identify {path} --model arx10B -o model.yaml" in said
    recording = read_csv(path, RecordingSettings())
    assert (len(recording), recording.dt_s) == (60, 0.05)
    assert recording.columns["gear"].tolist() == [1.0] * 60
    assert recording.columns["pitch_deg"].mean() == pytest.approx(-3.5, abs=0.5)
    mean = re.search(r"pump current: mean (\d+), (\d+) to (\d+) mA", said)
    assert mean is not None
    assert [int(group) for group in mean.groups()] == [
        round(value) for value in (recording.input.mean(), recording.input.min(), recording.input.max())
    ]


def test_a_seed_and_a_rate_are_taken(tmp_path: Path):
    recordings = []
    for seed, rate in ((5, 20), (5, 50), (6, 20)):
        path = tmp_path / f"{seed}-{rate}.csv"
        run("white_noise_short", *SHORT, "--out", path, "--seed", seed, "--rate", rate)
        recordings.append(read_csv(path, RecordingSettings()))
    one, finer, other = recordings
    assert len(finer) == 150
    assert one.input.mean() == pytest.approx(finer.input.mean(), abs=1.0)
    assert abs(one.input - other.input).max() > 100.0


def test_what_is_to_be_done_next_can_be_done_at_any_rate(tmp_path: Path, verb):
    path = tmp_path / "slow.csv"
    said = run("white_noise_short", "--seconds", 75, "--rate", 1, "--out", path).stdout
    assert f"cruise identify {path} --model arx10B --period 1 -o model.yaml" in said
    (_, line) = said.split("next: ")[1].splitlines()
    assert verb(*line.split()[1:])[0] == 0
    assert "--period" not in run("white_noise_short", *SHORT, "--rate", 5, "--out", path).stdout


def test_where_nothing_can_be_written_nothing_is_driven(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(verb.service, "drive_on_bus", lambda *given, **named: pytest.fail("it drove"))
    for path in (tmp_path, tmp_path / "a.txt"):
        with pytest.raises(SettingsError, match="--out"):
            run("white_noise_short", *SHORT, "--out", path)


def test_one_that_ended_early_is_written_and_is_no_success(tmp_path: Path):
    path = tmp_path / "fast.csv"
    result = run("white_noise_short", "--seconds", 6, "--gear", 4, "--out", path)
    assert result.exit_code == 1
    assert "ended early: too fast" in result.stderr
    assert len(read_csv(path, RecordingSettings())) < 120


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ((), "which experiment"),
        (("white_nose",), "did you mean white_noise"),
        (("polka",), "there are white_noise"),
        (("ramp", "--real", "--gear", "2"), "leave these options out"),
        (("ramp", "--real", "--seed", "2"), "leave these options out"),
        (("ramp", "--real"), "the settings have no commissioning; add it"),
        (("ramp", "--seconds", "4000"), "commissioning.duration_max_s is 1200"),
        (("ramp", "--experiments", "nowhere.yaml"), "nowhere.yaml"),
        (("ramp", "--rate", "30"), "--rate 30: a sample has to last whole steps of 0.01 s; give 1, 2, 4, 5, 10, 20"),
    ],
)
def test_refusals_are_plain(words: tuple[str, ...], complaint: str, tmp_path: Path):
    with pytest.raises(SettingsError) as caught:
        run(*words, "--out", tmp_path / "no.csv")
    assert complaint in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [("--gear", "5"), ("--mass", "100"), ("--slope", "40"), ("--seed", "-1")])
def test_what_no_machine_has_is_refused(words: tuple[str, ...]):
    result = run("ramp", *words)
    assert result.exit_code == 2
    assert words[0] in result.stderr


class Eavesdropper(Bus):
    """A bus on which everything was said before: it gives the frames of a drive, and may not be spoken to."""

    def __init__(self, frames: list[Frame]) -> None:
        super().__init__("can0")
        self.frames = frames

    def send(self, frame: Frame) -> Sent:
        raise AssertionError("a recorder says nothing")

    def close(self) -> None:
        pass

    def _take(self, timeout_s: float) -> Frame | None:
        raise AssertionError("`serve` is replaced")


def served(frames: list[Frame]):
    """`serve` without the clock: frames at their times, ticks in between."""

    def serve(node, bus, running, each_tick):
        now_s = 0.0
        for frame in frames:
            while now_s + node.period_s < frame.timestamp - 1e-6 and running():
                now_s += node.period_s
                node.tick(now_s)
                each_tick(now_s)
            node.receive(frame)

    return serve


def real_settings(tmp_path: Path, bus: str = "socketcan") -> Path:
    """Settings of a machine that is being commissioned with the experiment of the drive below."""
    for name in ("factory_model.yaml", "cruise.dbc", "cruise.eds"):
        (tmp_path / name).write_bytes((CONFIG / name).read_bytes())
    experiments = {"experiments": [msgspec.to_builtins(NOISE)]}
    (tmp_path / "mine.yaml").write_bytes(msgspec.json.encode(experiments))
    text = (CONFIG / "cruise.yaml").read_text().replace("bus: socketcan", f"bus: {bus}")
    (tmp_path / "cruise.yaml").write_text(text + "\ncommissioning:\n  experiments: mine.yaml\n")
    return tmp_path / "cruise.yaml"


@pytest.fixture(scope="module")
def overheard() -> list[Frame]:
    frames: list[Frame] = []
    Whole(tamper=lambda name, frame: (frames.append(frame), (frame,))[1]).run(18.0)
    return sorted(frames, key=lambda frame: frame.timestamp)


def test_on_a_real_bus_it_records_what_the_service_drives_and_says_nothing(tmp_path, overheard, monkeypatch):
    config, path = real_settings(tmp_path), tmp_path / "real.csv"
    monkeypatch.setattr(verb, "open_bus", lambda settings: Eavesdropper(overheard))
    monkeypatch.setattr(verb, "serve", served(overheard))
    result = run("noise", "--real", "--config", config, "--out", path)
    assert result.exit_code == 0, result.output
    assert "hold the request for experiment 3 and press set" in result.stdout
    assert "240 samples at 20 Hz, 12.0 s" in result.stdout
    recording = read_csv(path, RecordingSettings())
    assert recording.input.std() > 100.0
    with pytest.raises(SettingsError, match="is there already and is not overwritten"):
        run("noise", "--real", "--config", config, "--out", path)


def test_a_real_bus_on_which_nothing_began(tmp_path, monkeypatch):
    config, path = real_settings(tmp_path), tmp_path / "real.csv"
    silent = OperatorNode(codec(), ()).tick(0.1)
    monkeypatch.setattr(verb, "open_bus", lambda settings: Eavesdropper(silent))
    monkeypatch.setattr(verb, "serve", served(silent))
    with pytest.raises(SettingsError, match="was not begun on can0"):
        run("noise", "--real", "--config", config, "--out", path)
    assert not path.exists()


def test_a_virtual_bus_is_no_machine(tmp_path):
    with pytest.raises(SettingsError, match=r"can\.bus is virtual"):
        run("noise", "--real", "--config", real_settings(tmp_path, bus="virtual"), "--out", tmp_path / "real.csv")


def test_limits_of_the_machine_hold_for_the_virtual_one_too(tmp_path):
    config = real_settings(tmp_path)
    config.write_text(config.read_text() + "  limits: {current_max_ma: 900.0}\n")
    with pytest.raises(SettingsError, match=r"450 to 1050 mA is not within commissioning\.limits"):
        run("noise", "--config", config, "--out", tmp_path / "noise.csv")
