"""The settings of the service as a whole: where what they name lies, and which of them contradict each other."""

from pathlib import Path

import pytest

from cruise.service import settings as service_settings
from cruise.settings import SettingsError

NEEDED = "model: factory_model.yaml\ndatabase: cruise.dbc\n"


def test_what_the_settings_name_lies_beside_them_wherever_they_are_read_from(tmp_path: Path, monkeypatch):
    (tmp_path / "machine").mkdir()
    file = tmp_path / "machine" / "cruise.yaml"
    file.write_text(
        NEEDED + "persistence: {machine: A1, folder: kept}\ncommissioning: {experiments: e.yaml, speed_max_mps: 5}\n"
    )
    monkeypatch.chdir(tmp_path)
    for path in (file, Path("machine/cruise.yaml")):
        read = service_settings.load(path)
        assert read.persistence is not None
        assert read.commissioning is not None
        named = (read.model, read.database, read.dictionary, read.persistence.folder, read.commissioning.experiments)
        wanted = ("factory_model.yaml", "cruise.dbc", "cruise.eds", "kept", "e.yaml")
        assert [Path(one).resolve() for one in named] == [tmp_path / "machine" / one for one in wanted]


def test_a_folder_that_is_named_from_the_root_stays_where_it_is(tmp_path: Path):
    (tmp_path / "cruise.yaml").write_text(NEEDED + "persistence: {machine: A1}\n")
    kept = service_settings.load(tmp_path / "cruise.yaml").persistence
    assert kept is not None
    assert kept.folder == "/var/lib/cruise"


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ("engagement: {speed_min_mps: 0.5, speed_max_mps: 0.5}", r":3: engagement: speed_min_mps is 0\.5 and .* 0\.5:"),
        ("engagement: {speed_max_mps: 0.2}", "engagement: speed_min_mps is 0.3 and speed_max_mps 0.2: it would never"),
        ("setpoint_from: canopen", "there is no section canopen: no setpoint would ever come; add the section"),
        ("can: {addresses: {cruise: 0x31}}", "can.addresses: cruise and operator_panel have the same address, 0x31"),
        ("can: {addresses: {machine: 17}}", "can.addresses: cruise and machine have the same address, 0x11; give"),
        ('can: {channel: ""}', "can.channel: expected str of length >= 1"),
        ("control: {frame_s: 0.0005}", "control.frame_s: .*>= 0.01"),
        ("control: {predictive: {horizon_s: 300}}", "control.predictive.horizon_s: .*<= 10"),
        ("control: {observer: {pace_share: 1000}}", "control.observer.pace_share: .*<= 1"),
    ],
)
def test_what_could_never_drive_or_contradicts_itself_is_refused_with_its_place(tmp_path: Path, wrong: str, says: str):
    (tmp_path / "cruise.yaml").write_text(NEEDED + wrong)
    with pytest.raises(SettingsError, match=says):
        service_settings.load(tmp_path / "cruise.yaml")


@pytest.mark.parametrize(
    "right",
    [
        "engagement: {speed_min_mps: 0.5, speed_max_mps: 0.6}",
        "setpoint_from: canopen\ncanopen: {node_id: 17}",
        "can: {addresses: {engine: 0x31, cruise: null, machine: null}}",
    ],
)
def test_what_only_looks_like_it_is_taken(tmp_path: Path, right: str):
    (tmp_path / "cruise.yaml").write_text(NEEDED + right)
    service_settings.load(tmp_path / "cruise.yaml")
