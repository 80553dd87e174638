"""A model that nothing can drive with is refused in words, before it drives: at the start, and at a reload."""

from pathlib import Path

import pytest
from msgspec import structs

from cruise.cli.places import CONFIG
from cruise.service import settings as service_settings
from cruise.service.cruise_node import CruiseNode
from cruise.service.recordings import ReadingSettings, Told
from cruise.service.replay import replay
from cruise.settings import SettingsError


@pytest.mark.parametrize(
    "changed",
    [{"a_1": 1.0}, {"a_1": 1.5}, {"b_0_mps_per_ma": -1.0}, "no gain"],
    ids=["integrates", "runs away", "backwards", "no gain"],
)
def test_a_model_that_is_no_drive_is_refused_and_its_file_named(changed, tmp_path: Path):
    settings = service_settings.load(CONFIG / "cruise.yaml")
    lines = Path(settings.model).read_text().splitlines()
    for k, line in enumerate(lines):
        name = line.strip().split(":")[0]
        if changed == "no gain" and name.startswith("b_"):
            lines[k] = f"{line.split(':')[0]}: 0.0"
        elif isinstance(changed, dict) and name in changed:
            lines[k] = f"{line.split(':')[0]}: {changed[name]}"
    path = tmp_path / "bad.yaml"
    path.write_text("\n".join(lines))
    with pytest.raises(SettingsError, match=r"bad\.yaml"):
        CruiseNode.load(structs.replace(settings, model=str(path)))


def test_a_model_whose_current_is_counted_from_elsewhere_drives_nothing(tmp_path: Path):
    settings = service_settings.load(CONFIG / "cruise.yaml")
    path = tmp_path / "lever.yaml"
    path.write_text(Path(settings.model).read_text().replace("input_unit: ''", "input_rest_ma: 500"))
    settings = structs.replace(settings, model=str(path))
    with pytest.raises(
        SettingsError, match=r"lever\.yaml: its current is counted from 500 mA, where the machine stands"
    ):
        CruiseNode.load(settings)
    assert CruiseNode.load(settings, rest_ma=500.0).estimator.factory.na
    with pytest.raises(SettingsError, match=r"that of the bus from 0: give the current's signals in .* that offset"):
        replay([tmp_path / "sent.log"], settings, ReadingSettings(), Told("", 500.0, "lever.yaml"))


def test_settings_with_which_nothing_can_be_made_are_refused_in_words():
    settings = service_settings.load(CONFIG / "cruise.yaml")
    estimator = structs.replace(settings.estimator, cutoff_hz=1e-300)
    with pytest.raises(SettingsError, match="nothing drives with these"):
        CruiseNode.load(structs.replace(settings, estimator=estimator))
