"""The work of one tab without a browser: steps, parameters by hand, the report, the command lines that do it all."""

import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

pytest.importorskip("nicegui", reason="the extra workbench is not installed")

from nicegui import Client, ui
from nicegui.page import page

from cruise import settings
from cruise.can.settings import CanSettings, SourceAddresses
from cruise.cli.ladder import rungs_of
from cruise.cli.places import CONFIG
from cruise.columns import ActiveWhen, ColumnSettings
from cruise.effects import Custom, Stage
from cruise.effects.expression import ExpressionError
from cruise.model import files
from cruise.model.files import CustomTerm
from cruise.model.history import history_of
from cruise.service import settings as service_settings
from cruise.service.recordings import ReadingSettings
from cruise.settings import SettingsError
from cruise.workbench import commands, report
from cruise.workbench.by_hand import changed, judged, settings_of
from cruise.workbench.examples import EXAMPLES
from cruise.workbench.found import Question, Source
from cruise.workbench.live import Live
from cruise.workbench.page import Page
from cruise.workbench.session import MODEL, SEARCH, Session, Step, _example, moves
from cruise.workbench.setup import Setup
from cruise.workbench.verbs import added, by_hand, compared
from cruise.workbench.views import adding, comparing, failing
from cruise.workbench.views.adding import levels
from cruise.workbench.views.failing import stretches_of
from cruise.workbench.views.missing import floor_of
from cruise.workbench.views.tracks import timeline
from tests.workbench.conftest import quiet


def test_adding_lets_the_error_fall_to_the_floor(begun, better):
    assert better.error_after_mps < 0.2 * better.error_before_mps
    assert better.compared.error_mps < 0.2 * begun.error_mps
    assert files.read(better.path) == better.file


def test_it_is_said_where_a_model_is_judged_on_what_it_was_fitted_to(begun, better):
    assert begun.not_held_out == "", "fitted here, by blocks"
    assert "not held out" in better.compared.not_held_out


def test_the_heat_map_knows_the_cell_of_every_sample(begun):
    cells = begun.cells
    known = np.concatenate(cells.number)
    size = len(cells.row_labels) * len(cells.column_labels)
    share = np.bincount(known[known >= 0], minlength=size).reshape(cells.time_share.shape)
    judged_samples = np.isfinite(np.concatenate(begun.predicted.errors_mps)).sum()
    np.testing.assert_allclose(share / judged_samples, cells.time_share, atol=1e-12)
    cell = np.unravel_index(np.argmax(cells.error_share), cells.error_share.shape)
    marks, worst = stretches_of(cells, begun, (int(cell[0]), int(cell[1])), 0)
    assert worst is not None
    assert [mark for mark in marks if mark.strong] == [worst]


def test_by_hand_begins_where_the_fit_ended_and_shows_what_it_costs(better):
    values = {one.name: one.value for one in settings_of(better.file)}
    assert judged(better.file, values, better.compared) == pytest.approx(better.compared.error_mps, rel=1e-6)
    assert judged(better.file, values | {"grade.load": 0.0}, better.compared) > 5.0 * better.compared.error_mps
    core, model = changed(better.file, values | {"delay_s": 0.9})
    assert core.delay_s == 0.9
    assert model.delay == 4


def test_what_was_set_by_hand_is_a_model_file_that_every_verb_reads(recording, better, tmp_path):
    values = {one.name: one.value for one in settings_of(better.file)} | {"grade.load": 0.2}
    kept = by_hand([recording], Question(str(better.path)), better, values, "by hand", tmp_path / "hand.yaml", quiet)
    file = files.read(kept.path)
    files.model_of(kept.path, file)
    assert file.core is not None
    assert file.core.loads_mps == {"grade": 0.2}
    assert kept.error_after_mps > kept.error_before_mps
    assert "grade.load from " in file.provenance.note
    (step,) = history_of(kept.path, file)
    assert step.structure == "grade, set by hand (error on all data)"
    assert step.error_after_mps == kept.error_after_mps
    assert rungs_of((step,))[0].share is None or rungs_of((step,))[0].share == 0.0
    again = added([recording], Question(str(kept.path)), "sensor_bias", tmp_path / "again.yaml", quiet)
    assert [one.effect for one in history_of(again.path, again.file)] == ["", "sensor_bias"]


def ended(one: Session) -> Session:
    until = time.monotonic() + 60.0
    while one.busy and time.monotonic() < until:
        one.poll()
        time.sleep(0.02)
    return one


def test_what_is_stopped_is_taken_in_at_once(session):
    before = session.version
    session.add("grade")
    session.cancel()
    assert session.job is None
    assert session.fault == ""
    assert session.version == before + 1
    session.poll()
    assert session.version == before + 1


def test_a_refusal_names_what_helps_on_the_page(session, tmp_path):
    session.add("grade")
    assert re.search("has grade already: .* take it out with Undo$", ended(session).fault)
    path = tmp_path / "other.csv"
    path.write_text("Time [s],I_pump [mA],v [km/h]\n0,1,2\n")
    session.open(Source((path,), ReadingSettings(), "other"))
    fault = ended(session).fault
    assert session.asked is not None
    assert "it has Time [s], I_pump [mA], v [km/h]; say below what the columns mean" in fault
    assert "--" not in fault


def sent(session, name: str, text: str) -> Path:
    """A file as the page keeps what was dropped on it."""
    path = session.uploads / "once" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("name", "text", "remedy"),
    [
        ("drive.log", "(1600000000.0) can0 100#0011\n", "drop the log together with the machine's own DBC file"),
        ("short.csv", "".join(f"{0.05 * k:.2f},{k},{k}\n" for k in range(30)), "record for longer"),
        ("still.csv", "".join(f"{0.05 * k:.2f},{k % 70},0\n" for k in range(900)), "or change what the columns mean"),
    ],
)
def test_no_refusal_advises_an_option_of_the_command_line(session, name, text, remedy):
    head = "time_s,pump_current_ma,ground_speed_mps\n" if name.endswith(".csv") else ""
    path = sent(session, name, head + text)
    session.open(Source((path,), structs.replace(ReadingSettings(), database=str(CONFIG / "cruise.dbc")), name))
    ended(session)
    fault = ended(session).fault if session.busy else session.fault
    assert remedy in fault
    assert not re.search(r"--[a-z]|period", fault)


def test_a_file_that_was_sent_goes_by_its_name(session):
    path = sent(session, "Fahrt über Land (2).csv", "time_s,pump_current_ma,ground_speed_mps\n0,1,2\n")
    session.open(Source((path,), ReadingSettings(), path.name))
    assert ended(session).fault.startswith("Fahrt über Land (2).csv: 1 usable rows")
    path = sent(session, path.name, "time_s,pump_current_ma,ground_speed_mps\n" + "".join(
        f"{0.05 * k:.2f},{500 + 9 * (k // 40 % 7)},{k // 40 % 7}\n" for k in range(900)
    ))  # fmt: skip
    session.open(Source((path,), ReadingSettings(), path.name))
    ended(session)
    assert session.opened.recordings[0].source == path.name
    assert f"cruise compare '{path.name}'" in commands.lines(session)[0]


def test_only_what_a_service_was_watched_for_is_looked_for_unasked(session, tmp_path, monkeypatch):
    """The search that a live log asks for does not wait for the next recording; the bus is read as the service's."""
    opened, begun, read = session.opened, session.steps[0].compared, []

    def start(title, function, arguments, then, part=None):
        started.append(title)
        read.extend(one for one in arguments if isinstance(one, ReadingSettings))
        then(begun if "Comparing" in title else opened)

    started = []
    monkeypatch.setattr(session, "_start", start)
    service = service_settings.load(CONFIG / "cruise.yaml")
    other = structs.replace(service.can, addresses=structs.replace(service.can.addresses, machine=0x55))
    session.open_live(tmp_path / "live.log", structs.replace(service, can=other), 900.0)
    assert started[-1] == SEARCH
    assert session.steps[0].name == "the service's model"
    assert read[0].can == other
    monkeypatch.setattr(session, "compare", lambda: None)  # stopped before it came so far
    session.open_live(tmp_path / "live.log", service, 900.0)
    monkeypatch.undo()
    monkeypatch.setattr(session, "_start", start)
    session.open(Source((tmp_path / "a.csv",), ReadingSettings(), "a"))
    assert started[-1] == "Comparing the model with the recording"


def test_stairs_are_of_held_out_errors_alone(session, better):
    by_hand_too = replace(better, by_hand=True, error_after_mps=9.0)
    session.steps = [*session.steps, Step("by hand", Question("x"), None, by_hand_too), Step("+ b", Question("y"))]
    session.steps[3].added = replace(better, error_after_mps=0.5)
    found = levels(session)
    assert [level.place for level in found] == [0, 1, 3]
    assert [level.error_mps for level in found] == [better.error_before_mps, better.error_after_mps, 0.5]


def test_a_term_of_ones_own_is_fitted_and_written_into_the_file(recording, tmp_path):
    term = CustomTerm(name="hill", stage=Stage.LOAD, expression="p1*pitch_deg", bounds={"p1": (-1.0, 1.0)})
    found = added([recording], Question(MODEL), term, tmp_path / "hill.yaml", quiet)
    assert found.error_after_mps < 0.2 * found.error_before_mps
    assert isinstance(files.load(found.path).effects[0], Custom)


def test_bounds_of_a_term_that_no_command_says_are_said(session, better):
    term = CustomTerm(name="hill", stage=Stage.LOAD, expression="p1*pitch_deg", bounds={"p1": (-50.0, 50.0)})
    session.steps[1].added = replace(better, effect="hill", file=structs.replace(better.file, custom=term))
    lines = commands.lines(session)
    place = next(k for k, line in enumerate(lines) if line.startswith("cruise add 'custom(hill, load, p1*pitch_deg)'"))
    assert lines[place - 1].startswith("# hill was fitted with p1 from -50 to 50")
    usual = structs.replace(term, bounds={"p1": (-1.0, 1.0)})
    session.steps[1].added = replace(better, effect="hill", file=structs.replace(better.file, custom=usual))
    assert not any(line.startswith("#") for line in commands.lines(session))


def test_a_term_that_is_called_like_an_effect_is_refused_before_it_is_fitted(recording, tmp_path):
    wrong = CustomTerm(name="grade", stage=Stage.LOAD, expression="p1*pitch_deg")
    with pytest.raises(ExpressionError, match="grade is an effect already"):
        added([recording], Question(MODEL), wrong, tmp_path / "g.yaml", quiet)
    assert not (tmp_path / "g.yaml").exists()


@pytest.mark.parametrize("question", [Question("arx:na=1,nb=3,dealy_s=0.5"), Question(MODEL, horizon_s=-1.0)])
def test_a_question_that_is_none_leaves_the_steps_as_they_are(session, question):
    steps = list(session.steps)
    session.ask(question)
    assert session.fault
    assert (session.steps, session.at, session.busy) == (steps, 1, False)


@pytest.mark.parametrize("horizon_s", [np.nan, -1.0, 0.0, np.inf])
def test_a_horizon_that_is_no_time_is_refused(recording, horizon_s):
    with pytest.raises(SettingsError, match="give a time in s above 0"):
        compared([recording], Question(MODEL, horizon_s=horizon_s), quiet)


def test_the_horizon_is_that_which_was_judged(session, recording):
    session.steps = [Step(MODEL, Question(MODEL, horizon_s=2.5), compared([recording], Question(MODEL, 2.5), quiet))]
    session.at = 0
    assert session.step.compared.figures[0].name == "2.4 s ahead"
    with Client(page(""), request=None):
        shown = timeline(Page(session, session.setup, Live(), ui.context.client), compact=True)
    assert [line.name for line in shown.lines if "ahead" in line.name] == ["model, 2.4 s ahead"]


def test_a_stopped_comparison_can_be_begun_again(session):
    session.steps, session.at = [Step(MODEL, Question(MODEL), predicted=session.steps[0].compared.predicted)], 0
    for view in (failing, comparing):
        with Client(page(""), request=None) as client:
            view.show(Page(session, session.setup, Live(), client))
        words = [one.text for one in client.elements.values() if isinstance(one, ui.button)]
        assert "Compare" in words


def test_what_was_set_by_hand_is_not_called_fitted(session, better):
    for hand, said, unsaid in ((False, "as fitted", "as set by hand"), (True, "as set by hand", "as fitted")):
        session.steps[1].added = replace(better, by_hand=hand)
        with Client(page(""), request=None) as client:
            adding.show(Page(session, session.setup, Live(), client))
        words = " ".join(str(getattr(one, "text", "")) for one in client.elements.values()).lower()
        assert said in words
        assert unsaid not in words


def test_a_bundled_recording_is_read_under_its_own_names(tmp_path):
    example = replace(EXAMPLES[0], seconds=60.0)
    setup = Setup(ReadingSettings(input="pump_pct", output="v"), CONFIG, tmp_path)
    assert len(_example(setup, example, quiet).recordings[0]) == 1200


def test_undo_and_redo_go_along_the_steps_and_not_beyond(session):
    session.redo()
    assert session.at == 1
    session.undo()
    assert session.step.added is None
    session.undo()
    assert session.at == 0
    session.redo()
    assert session.step.name == "+ grade"


def test_the_command_lines_do_the_same(session):
    lines = commands.lines(session)
    assert lines[0] == f"cruise compare 'monday'\"'\"'s drive.csv' --model {MODEL}"
    assert f"cruise add grade --model {MODEL} 'monday'\"'\"'s drive.csv' -o better.yaml" in lines
    session.undo()
    assert len(commands.lines(session)) == 1


def test_the_command_lines_name_the_database_that_was_dropped(session):
    reading = ReadingSettings(database="/anywhere/theirs.dbc")
    session.opened = replace(session.opened, source=replace(session.opened.source, reading=reading))
    assert commands.lines(session)[0].endswith(" --database theirs.dbc")


def test_what_the_columns_mean_is_a_settings_file(session, tmp_path):
    reading = ReadingSettings(
        input="I",
        columns={"v": ColumnSettings(signal="wheel_speed_mps", scale=1 / 3.6), "I": ColumnSettings()},
        active_when=ActiveWhen(column="safe", above=0.4),
        can=CanSettings(addresses=SourceAddresses(machine=0x55)),
    )
    session.opened = replace(session.opened, source=replace(session.opened.source, reading=reading))
    path = tmp_path / commands.COLUMNS
    path.write_text(commands.column_settings(session))
    assert settings.load(path, ReadingSettings) == reading
    assert commands.lines(session)[0].endswith(f"--columns {commands.COLUMNS}")


def test_the_report_holds_everything_and_runs_nothing(session, better):
    text = report.as_html(session)
    assert "&lt;b&gt;monday&lt;/b&gt;" in text
    assert "<script" not in text
    assert text.count("data:image/png;base64,") == 2
    assert f"{better.compared.figures[0].rmse_mps:.4f}" in text
    assert report.as_pdf(session).startswith(b"%PDF")


def test_a_signal_with_holes_moves_all_the_same(session, recording):
    holes = np.where(np.arange(len(recording)) % 7 == 0, np.nan, recording.columns["pitch_deg"])
    still = np.where(np.isnan(holes), np.nan, 3.0)
    columns = {**recording.columns, "pitch_deg": holes, "still": still, "never": np.full(len(recording), np.nan)}
    found = replace(session.opened, recordings=(replace(recording, columns=columns),))
    assert [moves(found, name) for name in ("pitch_deg", "still", "never")] == [True, False, False]


def test_a_floor_from_above_is_not_called_one_from_below():
    assert floor_of(0.01, 0.02)[:2] == (0.01, "noise floor")
    assert floor_of(np.nan, 0.02)[:2] == (0.02, "noise floor, at most")
