"""tools/bench opening: on a few rows and frames."""

import json

from tools.benchmarks import opening
from tools.benchmarks.__main__ import PARTS


def test_it_opens_one_of_each_kind(monkeypatch):
    assert PARTS["opening"] is opening.measure
    monkeypatch.setattr(opening, "ROWS", 200)
    monkeypatch.setattr(opening, "FRAMES", 500)
    found = opening.measure()
    json.dumps(found.as_json(), allow_nan=False)
    figures = {figure.key: figure for figure in found.figures}
    assert set(figures) == {"csv_s", "parquet_s", "mf4_s", "blf_s"}
    assert all(figure.value > 0.0 for figure in found.figures)
    assert figures["csv_s"].meaning == "opening .csv, 200 rows, 9 columns, 200 samples of 0.05 s"
    assert figures["blf_s"].meaning.startswith("opening .blf, 500 frames through the DBC file, 10 columns")
    assert all(figures[key].meaning.endswith("9 columns, 200 samples of 0.05 s") for key in ("parquet_s", "mf4_s"))
