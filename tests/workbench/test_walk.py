"""The walk of an engineer, in a real browser: open, see the error, where it fails, ask, add, take the model away."""

import json
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from asammdf import MDF, Signal
from pyarrow import parquet

from cruise.recording import Recording
from cruise.signals import INPUT, OUTPUT
from tests.workbench.conftest import laid_out

PREDICTED = "model, 3 s ahead"


def go(page, name: str) -> None:
    page.locator("nav").get_by_text(name, exact=True).click()


def open_example(page, name: str) -> None:
    page.locator(f'[data-example="{name}"]').click()
    page.get_by_text("How good, and how good at best").wait_for()


def error_of(page) -> float:
    """The RMS error that the table of the view shows."""
    row = page.locator("table.figures tr", has_text="s ahead").first
    return float(row.locator("td").nth(1).inner_text())


def idle(page) -> None:
    page.locator(".dock").wait_for(state="hidden")


def test_from_a_recording_to_a_better_model(visit, cache, tmp_path, verb):
    page = visit()
    open_example(page, "sometimes-slow")
    before = error_of(page)
    assert before > 0.1
    idle(page)

    go(page, "Where it fails")
    page.get_by_text(re.compile("of the squared error stands in .* uphill")).wait_for()
    page.locator(".row-button", has_text="slope > 4 deg").first.click()
    page.locator(".row-button.here").wait_for()

    go(page, "What is missing")
    page.get_by_role("button", name="What is missing?").click()
    page.locator('[data-verdict="missing"]').wait_for()
    assert page.locator("[data-add]").first.get_attribute("data-add") == "grade"
    page.locator("[data-add]").first.click()

    page.get_by_text("held-out error of this step").wait_for()
    idle(page)
    go(page, "Compare")
    page.get_by_text("taken as it is, nothing was fitted").wait_for()
    after = error_of(page)
    assert after < 0.1 * before

    go(page, "Take away")
    with page.expect_download() as download:
        page.get_by_role("button", name="Model file").click()
    model = tmp_path / "better.yaml"
    download.value.save_as(model)
    recording = next(cache.rglob("sometimes-slow.csv"))
    code, out, _ = verb("compare", recording, "--model", model, "--json")
    assert code == 0
    assert f"{json.loads(out)['ahead']['rmse_mps']:.4f}" == f"{after:.4f}"

    with page.expect_download() as download:
        page.get_by_role("button", name="HTML").click()
    report = tmp_path / "report.html"
    download.value.save_as(report)
    text = report.read_text()
    assert "grade is missing" in text
    assert text.count("data:image/png;base64,") >= 3
    assert not re.search(r'(?:src|href)="(?!data:)', text), "the report needs something outside of it"
    with page.expect_download() as download:
        page.get_by_role("button", name="PDF").click()
    download.value.save_as(tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")

    go(page, "Add")
    page.get_by_role("button", name="Undo").click()
    page.locator(".row-button.here", has_text="where it began").wait_for()
    page.get_by_role("button", name="Redo").click()
    page.locator(".row-button.here", has_text="grade").wait_for()
    shown = page.locator(".figure", has_text=re.compile(r"^0\.00\d+$"))
    shown.wait_for()
    page.get_by_label("grade.load").locator("[tabindex]").focus()
    page.keyboard.press("PageDown")
    page.get_by_text("m/s RMS ahead, set by hand").wait_for()


def test_a_model_that_is_typed_is_meant_without_enter_and_stays_where_it_is_refused(visit):
    page = visit()
    open_example(page, "nothing-hidden")
    idle(page)
    go(page, "Open")
    for typed, said in (("arx:na=1,nb=", "arx:na=1,nb="), ("oe1", "")):
        model = page.get_by_label("Name, or structure written out")
        model.click()
        page.keyboard.press("Control+A")
        model.press_sequentially(typed)
        model.evaluate("field => field.dataset.typed = ''")
        page.get_by_role("button", name="Compare with this model").click()
        if said:
            assert said in page.get_by_role("alert").inner_text()
            page.locator("input[data-typed]").wait_for(state="detached")  # the view is shown anew
            assert model.input_value() == typed
    idle(page)
    go(page, "Add")
    page.locator(".row-button.here", has_text="oe1").wait_for()


def test_a_file_that_is_none_is_refused_with_the_reason(visit, tmp_path):
    page = visit()
    broken = tmp_path / "broken.csv"
    broken.write_text("time_s,pump_current_ma,ground_speed_mps\n0,1\n")
    page.locator("input[type=file]").set_input_files(broken)
    alert = page.get_by_role("alert")
    alert.wait_for()
    assert "broken.csv" in alert.inner_text()


MEANT = (("t_ms", "time_s", "ms"), ("I_amps", "pump_current_ma", "A"), ("v_kmh", "ground_speed_mps", "km/h"))


def strange(folder: Path, ending: str, recording: Recording) -> Path:
    """The recording in a file whose columns have names and units that nobody knows."""
    path = folder / f"strange{ending}"
    rows = {"t_ms": 1e3 * recording.time_s, "I_amps": 1e-3 * recording.input, "v_kmh": 3.6 * recording.output}
    match ending:
        case ".csv":
            table = np.column_stack(list(rows.values()))
            np.savetxt(path, table, delimiter=",", header=",".join(rows), comments="")
        case ".parquet":
            parquet.write_table(pa.table(rows), path)
        case ".mf4":
            with MDF() as file:
                for name in ("I_amps", "v_kmh"):
                    file.append([Signal(rows[name], recording.time_s, name=name)])
                file.save(path)
    return path


@pytest.mark.parametrize("ending", [".csv", ".parquet", ".mf4"])
def test_columns_of_other_names_and_units_are_asked_for(visit, tmp_path, one_recording, ending):
    page = visit()
    page.locator("input[type=file]").set_input_files(strange(tmp_path, ending, one_recording))
    page.get_by_text("What do the columns mean?").wait_for()
    laid_out(page)
    for column, meaning, unit in MEANT[ending == ".mf4" :]:  # a measurement has times of its own
        for what, value in ((f"meaning of {column}", meaning), (f"unit of {column}", unit)):
            page.get_by_label(what).click()
            page.get_by_role("option", name=value, exact=True).click()
            page.wait_for_function("!document.querySelector('[role=option]')")  # a list fades before it is gone
    page.get_by_role("button", name="Open it like this").click()
    page.get_by_text("How good, and how good at best").wait_for()
    page.get_by_text("no context signals").wait_for()
    persistence = page.locator("table.figures tr", has_text="persistence").locator("td").nth(1).inner_text()
    assert float(persistence) == pytest.approx(_persistence(one_recording), rel=0.1)
    go(page, "Open")
    page.get_by_role("button", name="Change what the columns mean").click()
    page.get_by_text("What do the columns mean?").wait_for()
    assert page.get_by_label("unit of v_kmh").input_value() == "km/h", "what was said is not forgotten"


def _persistence(recording) -> float:
    """RMS change of the speed over 3 s, by hand."""
    shift = round(3.0 / recording.dt_s)
    return float(np.sqrt(np.mean((recording.output[shift:] - recording.output[:-shift]) ** 2)))


@pytest.fixture(scope="session")
def one_recording() -> Recording:
    """A minute and a half of a first-order drive: current, speed, and nothing else."""
    rng = np.random.default_rng(4)
    current = np.repeat(rng.uniform(400.0, 1000.0, 40), 60)[:1800]
    speed = np.zeros(1800)
    for k in range(10, 1800):
        speed[k] = speed[k - 1] + 0.05 / 0.6 * (0.003 * current[k - 10] - speed[k - 1])
    columns = {INPUT: current, OUTPUT: speed + rng.normal(0.0, 0.005, 1800)}
    return Recording(0.05 * np.arange(1800), columns, 0.05, "made up")


def test_a_search_can_be_stopped_and_nothing_is_lost(visit):
    page = visit()
    open_example(page, "nothing-hidden")
    idle(page)
    go(page, "What is missing")
    page.get_by_role("button", name="What is missing?").click()
    page.locator(".chip").nth(3).wait_for()
    page.get_by_role("button", name="Stop").click()
    page.get_by_role("button", name="What is missing?").wait_for()
    assert page.get_by_role("alert").count() == 0
    go(page, "Compare")
    assert error_of(page) < 0.1


def test_two_visitors_have_their_own_work_and_a_reload_keeps_it(visit):
    first, second = visit(), visit()
    open_example(first, "sometimes-slow")
    open_example(second, "nothing-hidden")
    assert error_of(first) > 0.1 > error_of(second)
    mine = error_of(first)
    first.reload()
    first.get_by_text("How good, and how good at best").wait_for()
    assert error_of(first) == mine
    first.locator("nav").get_by_text("Sometimes slow").wait_for()
    second.locator("nav").get_by_text("Nothing hidden").wait_for()


def test_the_keyboard_reaches_what_the_mouse_does(visit):
    page = visit()
    for _ in range(60):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.dataset.example") == "nothing-hidden":
            break
    page.keyboard.press("Enter")
    page.get_by_text("How good, and how good at best").wait_for()
    reached = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.getAttribute('aria-label')"))
    assert {"earlier", "later", "zoom in", "zoom out", "the whole recording"} <= reached


def test_zoom_loads_what_is_seen(visit):
    page = visit()
    open_example(page, "sometimes-slow")
    idle(page)
    points = "document.querySelector('.js-plotly-plot').data[0].x"
    whole = page.evaluate(f"{points}.length")
    assert 1500 < whole < 4000, "of 9600 samples"
    step = page.evaluate(f"{points}[1001] - {points}[1000]")
    for _ in range(4):
        page.get_by_label("zoom in").click()
        page.wait_for_timeout(400)
    page.wait_for_function(f"{points}[101] - {points}[100] < 0.06")
    assert step > 0.06
    page.get_by_label("the whole recording").click()
    page.wait_for_function(f"{points}.length > 1500 && {points}[0] < 1 && {points}.at(-1) > 479")


def test_a_running_service_is_watched_and_let_go(visit):
    page = visit()
    go(page, "Live")
    page.get_by_role("button", name="Watch the combine").click()
    page.get_by_text("Watching the virtual combine").wait_for()
    page.get_by_text("engaged", exact=True).wait_for()
    page.locator("td", has_text="a_1").wait_for()
    page.wait_for_function("document.querySelectorAll('.js-plotly-plot')[1]?.data?.[2]?.y?.some(Number.isFinite)")
    page.get_by_role("button", name="Stop watching").click()
    page.get_by_text("the virtual combine: ended").wait_for()
    page.get_by_role("button", name="Forget it").click()
    page.get_by_role("button", name="Watch the combine").wait_for()
