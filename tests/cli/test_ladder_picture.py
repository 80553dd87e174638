"""The picture of `cruise ladder`: what is written in it can be read."""

from itertools import pairwise

import numpy as np
import pytest
from matplotlib import pyplot as plt

from cruise.cli import ladder_picture
from cruise.cli.ladder import rungs_of
from cruise.model.files import Step


def steps(*errors_mps: float) -> tuple[Step, ...]:
    """A history of these held-out errors."""
    return tuple(
        Step(
            effect=f"effect_{place}", structure="", error_before_mps=before, error_after_mps=after, horizon_s=3.0,
            recordings=("drive.csv, 0123",), samples=1000, made_on="2026-08-01", floor_at_least_mps=0.009,
            floor_at_most_mps=0.01,
        )
        for place, (before, after) in enumerate(pairwise(errors_mps), 1)
    )  # fmt: skip


@pytest.mark.parametrize(
    "errors_mps", [(0.1, 0.099, 0.0985), (0.1, 0.02, 0.0199), (0.1, 0.101, 0.05, 0.09), (0.1, 0.1)]
)
def test_no_change_is_written_over_a_level(errors_mps, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(plt, "close", drawn.append)
    ladder_picture.draw(rungs_of(steps(*errors_mps)), "m.yaml", tmp_path / "p.png")
    monkeypatch.undo()
    (figure,) = drawn
    (axis,) = figure.axes
    figure.canvas.draw()
    levels = [line for line in axis.get_lines() if len(np.unique(line.get_ydata())) == 1]
    texts = [one for one in axis.texts if one.get_text().endswith(" %")]
    assert len(texts) == len(errors_mps) - 1
    boxes = [
        one.get_window_extent() for one in [*texts, *(one for one in axis.texts if one.get_text() and one not in texts)]
    ]
    for place, box in enumerate(boxes[: len(texts)]):
        for line in levels:
            ends = axis.transData.transform(line.get_xydata())
            across = ends[0, 0] < box.x1 and ends[1, 0] > box.x0
            assert not (across and box.y0 < ends[0, 1] < box.y1), f"a level crosses {texts[place].get_text()}"
        assert not any(box.overlaps(other) for k, other in enumerate(boxes) if k != place)
    plt.close(figure)
