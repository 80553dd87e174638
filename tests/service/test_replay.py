"""Measured drives through the service: what the online model learned, judged on files that it has not seen."""

import pytest

from cruise import settings
from cruise.cli.places import CONFIG
from cruise.service import replay
from cruise.service import settings as service_settings
from cruise.service.recordings import ReadingSettings


@pytest.fixture(scope="module")
def learned(dart):
    loaded = service_settings.load(CONFIG / "dart.yaml")
    columns = settings.load(CONFIG / "dart_columns.yaml", ReadingSettings)
    files = sorted(dart.glob("*/*.csv"))
    taught = replay.replay(files[::2], loaded, columns)
    unseen = replay.replay(files[1::2], loaded, columns)
    return taught, replay.judge(taught, unseen.recordings)


def test_every_measured_drive_goes_through_the_service_whole(learned):
    taught, _ = learned
    assert len(taught.recordings) == 20
    assert not {name for name in taught.node.hearing.faults if name != "unknown"}
    assert sum(len(one) for one in taught.recordings) > 3000


def test_the_online_model_beats_its_start_and_persistence_on_unseen_files(learned):
    _, judged = learned
    assert judged.samples > 1500
    assert judged.online_mps < 0.5 * judged.persistence_mps
    assert judged.online_mps < 0.85 * judged.factory_mps
    assert judged.online_mps < 1.5 * judged.batch_mps
