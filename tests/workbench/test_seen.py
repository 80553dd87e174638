"""What is seen of the page by whoever uses the keyboard or a screen reader, and by night."""

import numpy as np

from tests.workbench.conftest import WIDTHS, laid_out
from tests.workbench.test_walk import go, idle, open_example

CONTRAST = 4.5  # of a text with what is behind it (WCAG 2.2, 1.4.3)
FAINT_BUTTONS = """(least) => {
  const paint = document.createElement("canvas").getContext("2d")
  const light = color => {
    paint.fillStyle = color; paint.fillRect(0, 0, 1, 1)
    const [r, g, b] = [...paint.getImageData(0, 0, 1, 1).data].map(v => v / 255)
      .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b + 0.05
  }
  return [...document.querySelectorAll(".q-btn.bg-primary")].filter(one => one.checkVisibility()).map(one => {
    const style = getComputedStyle(one), text = light(style.color), behind = light(style.backgroundColor)
    return [one.innerText, Math.max(text, behind) / Math.min(text, behind)]
  }).filter(([, contrast]) => contrast < least)
}"""
FOCUS = """() => {
  const one = document.activeElement, style = getComputedStyle(one), field = one.closest(".q-field--focused")
  const seen = field !== null || (style.outlineStyle !== "none" && parseFloat(style.outlineWidth) > 0)
  return [(one.getAttribute("aria-label") || one.innerText || one.tagName).slice(0, 40), one.tagName, seen]
}"""


def test_the_buttons_can_be_read_by_day_and_by_night(visit):
    page = visit()
    open_example(page, "nothing-hidden")
    idle(page)
    for other in ("light", "dark"):  # what the button that turns the page around says then
        for name in ("Open", "What is missing", "Take away", "Live"):
            go(page, name)
            page.locator("nav [aria-current=page]", has_text=name).wait_for()
            page.locator(".q-btn.bg-primary").first.wait_for()
            assert page.evaluate(FAINT_BUTTONS, CONTRAST) == [], name
        page.locator("nav").get_by_role("button").last.click()
        page.locator("nav").get_by_role("button", name=other).wait_for()


def test_it_is_seen_where_the_keyboard_is(visit):
    page = visit()
    open_example(page, "nothing-hidden")
    idle(page)
    unseen, buttons = [], 0
    for _ in range(24):
        page.keyboard.press("Tab")
        name, tag, seen = page.evaluate(FOCUS)
        buttons += tag == "BUTTON"
        if not seen and tag != "BODY":
            unseen.append(name)
    assert unseen == []
    assert buttons > 4


def test_a_screen_reader_is_told_the_language_and_the_one_main_part(visit):
    page = visit()
    assert page.evaluate("document.documentElement.lang") == "en-US"
    assert page.get_by_role("main").count() == 1


def test_a_long_name_of_a_file_stays_in_its_place(visit, tmp_path):
    path = tmp_path / ("harvest_north_of_the_river_with_the_new_header_" * 3 + ".csv")
    rng = np.random.default_rng(4)
    current = np.repeat(rng.uniform(400.0, 1000.0, 40), 60)[:1800]
    speed = np.convolve(current, np.exp(-np.arange(60) / 12.0) / 4000.0)[:1800] + rng.normal(0.0, 0.005, 1800)
    table = np.column_stack([0.05 * np.arange(1800), current, speed])
    np.savetxt(path, table, delimiter=",", header="time_s,pump_current_ma,ground_speed_mps", comments="")
    page = visit()
    page.locator("input[type=file]").set_input_files(path)
    page.get_by_text("How good, and how good at best").wait_for()
    idle(page)
    go(page, "Open")
    page.get_by_text("Change what the columns mean").wait_for()
    laid_out(page)
    for width in (WIDTHS[0], WIDTHS[1], 800):
        page.set_viewport_size({"width": width, "height": 900})
        said, rail = (page.locator(one).first.bounding_box() for one in ("nav .sub", "nav"))
        assert said["x"] + said["width"] <= rail["x"] + rail["width"]


def test_the_table_of_the_parameters_is_seen_whole_on_a_narrow_page(visit):
    page = visit()
    open_example(page, "sometimes-slow")
    idle(page)
    go(page, "Add")
    page.get_by_label("Expression").fill("1 + p1*tanh(pitch_deg)")
    page.get_by_role("button", name="See whether it helps").click()
    page.get_by_text("held-out error of this step").wait_for()
    idle(page)
    page.set_viewport_size({"width": 800, "height": 900})
    table = page.locator("table.figures", has_text="as fitted")
    assert table.evaluate("one => one.scrollWidth <= one.clientWidth")
    laid_out(page)
