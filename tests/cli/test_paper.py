"""`cruise paper` as a user meets it; what it computes is tested in tests/paper."""

import pytest

from cruise.cli.paper import _ours
from cruise.paper.reproduce import Row


def test_a_folder_that_is_not_there_is_one_clear_line(verb, tmp_path):
    code, printed, said = verb("paper", "--folder", tmp_path / "nowhere")
    assert code == 2
    assert printed == ""
    assert "experiments.yaml" in said
    assert "Traceback" not in said


def test_a_picture_of_no_known_kind_is_refused_before_anything_is_driven(verb):
    code, _, said = verb("paper", "--picture", "paper.txt")
    assert code == 2
    assert "--picture paper.txt" in said


@pytest.mark.parametrize(
    ("ours", "unstable_pct", "text"),
    [(74.25, 0.0, "74.2±1.5"), (None, 60.0, "- in 60%"), (65.0, 40.0, "65.0±1.5 (- in 40%)")],
)
def test_an_unstable_predictor_is_never_a_number(ours, unstable_pct, text):
    assert _ours(Row("V", "narx2", 20.0, None, ours, 1.5, unstable_pct)) == text
