"""tools/bench workbench: on a few seconds instead of an hour."""

import json
from dataclasses import replace

import pytest

from tools.benchmarks import workbench
from tools.benchmarks.__main__ import PARTS


def test_it_times_the_first_picture_and_every_act(monkeypatch):
    assert PARTS["workbench"] is workbench.measure
    monkeypatch.setattr(workbench, "HOUR", replace(workbench.HOUR, seconds=60.0))
    monkeypatch.setattr(workbench, "OPENINGS", 1)
    monkeypatch.setattr(workbench, "ACTS", ("wheel in", "drag", "later", "the whole recording"))
    found = workbench.measure()
    if not found.figures:
        pytest.skip(found.notes[0])
    json.dumps(found.as_json(), allow_nan=False)
    figures = {figure.key: figure for figure in found.figures}
    assert 0.0 < figures["first_picture_s"].value <= figures["first_picture_worst_s"].value
    assert figures["predicted_s"].value >= figures["first_picture_s"].value
    assert 0.0 < figures["act_ms"].value <= figures["act_worst_ms"].value
    assert figures["act_ms"].meaning == "4 zooms and pans, median"
    assert figures["first_picture_s"].meaning.startswith("1,200 samples dropped as .csv")
