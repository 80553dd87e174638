"""The settings of the service as a whole: where what they name lies, and which of them contradict each other."""

from pathlib import Path

from cruise.service import settings as service_settings

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
