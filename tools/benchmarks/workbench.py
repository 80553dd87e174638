"""How long the workbench takes to show an hour at 20 Hz, and to follow every zoom and pan, in a real Chromium.

Timed in the browser, from the user's act until the picture with the samples of the new window is painted.
"""

import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Final

from playwright.sync_api import Page

from cruise.workbench.examples import EXAMPLES, make
from tools.page.served import NoBrowserError, chromium, served

from .figures import Figure, Part

FIRST_S, ACT_MS = 3.0, 200.0
OPENINGS: Final = 3
HOUR: Final = EXAMPLES[2]
PATIENCE_MS: Final = 120_000
DRAWN: Final = "document.querySelector('.js-plotly-plot')?.querySelector('.scatterlayer .trace path.js-line')"
PREDICTED: Final = "document.querySelector('.js-plotly-plot')?.data?.length > 3"
TIMED: Final = """act => new Promise(done => {
    const plot = document.querySelector('.js-plotly-plot'), begin = performance.now()
    plot.once('plotly_update', () => requestAnimationFrame(() => setTimeout(() => done(performance.now() - begin))))
    const box = plot.querySelector('.nsewdrag').getBoundingClientRect()
    const x = box.left + 0.4 * box.width, y = box.top + 0.5 * box.height
    const mouse = (kind, to, x) => to.dispatchEvent(
        new MouseEvent(kind, {bubbles: true, cancelable: true, view: window, clientX: x, clientY: y, button: 0}))
    if (act === 'wheel in' || act === 'wheel out')
        plot.querySelector('.nsewdrag').dispatchEvent(new WheelEvent('wheel', {bubbles: true, cancelable: true,
            clientX: x, clientY: y, deltaY: act === 'wheel in' ? -200 : 200}))
    else if (act === 'drag') {
        mouse('mousedown', plot.querySelector('.nsewdrag'), x)
        mouse('mousemove', document, x - 60)
        mouse('mousemove', document, x - 160)
        mouse('mouseup', document, x - 160)
    } else
        document.querySelector(`[aria-label="${act}"]`).click()
})"""
ACTS: Final = (
    *["wheel in"] * 6, "drag", "later", "drag", "earlier", *["wheel out"] * 3, "drag", "zoom in", "later", "zoom out",
    "the whole recording",
)  # fmt: skip


def measure() -> Part:
    """Drop the file, wait for the picture, then zoom and pan; nothing where there is no browser."""
    try:
        return _measured()
    except NoBrowserError as error:
        return Part((), notes=(f"not measured: {error}",))


def _measured() -> Part:
    with tempfile.TemporaryDirectory() as folder:
        path = make(HOUR, Path(folder) / "cruise")
        with served(Path(folder), Path(folder) / "said.txt") as address, chromium() as browser:
            first_s, all_s, acts_ms = [], [], []
            for _ in range(OPENINGS):
                page = browser.new_page(viewport={"width": 1440, "height": 900})
                page.set_default_timeout(PATIENCE_MS)
                page.goto(address)
                page.get_by_text("Your own").wait_for()
                begin_s = perf_counter()
                page.locator("input[type=file]").set_input_files(path)
                page.wait_for_function(DRAWN, polling=20)
                first_s.append(perf_counter() - begin_s)
                page.wait_for_function(PREDICTED, polling=20)
                all_s.append(perf_counter() - begin_s)
                page.get_by_text("How good, and how good at best").wait_for()
                page.locator(".dock").wait_for(state="hidden")
                acts_ms += [_timed(page, act) for act in ACTS]
                page.close()
    samples = f"{round(HOUR.seconds * 20):,} samples dropped as .csv"
    return Part(
        (
            Figure("first_picture_s", median(first_s), "s", f"{samples}: the measured speed is drawn, median", FIRST_S),
            Figure("first_picture_worst_s", max(first_s), "s", f"the same, worst of {OPENINGS}"),
            Figure("predicted_s", median(all_s), "s", "the model is fitted and its prediction drawn beside, median"),
            Figure("act_ms", median(acts_ms), "ms", f"{len(acts_ms)} zooms and pans, median", ACT_MS),
            Figure("act_worst_ms", max(acts_ms), "ms", "the slowest of them", ACT_MS),
        ),
        (HOUR.seed,),
    )


def _timed(page: Page, act: str) -> float:
    took_ms = float(page.evaluate(TIMED, act))
    page.wait_for_timeout(300)
    return took_ms
