"""The workbench as it is used, served by the verb itself and walked through in a real browser; and without one."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from cruise.cli.places import CONFIG

LAID_OUT = Path(__file__).with_name("laid_out.js").read_text()
WIDTHS = (1440, 1024, 768, 390)
PATIENCE_MS = 600_000  # until something is there: jobs give way to whatever else runs, and here other tests do


@pytest.fixture(scope="package")
def cache(tmp_path_factory) -> Path:
    """Where the bundled recordings are kept while the tests run."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="package")
def server(cache, tmp_path_factory) -> Iterator[str]:
    """Address of a workbench that runs as `cruise workbench` starts it."""
    pytest.importorskip("nicegui", reason="the extra workbench is not installed")
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed: no walk in a browser")
    from tools.page.served import served

    said = tmp_path_factory.mktemp("server") / "said.txt"
    with served(cache, said) as address:
        yield address
    assert "Traceback" not in said.read_text(), said.read_text()


@pytest.fixture(scope="package")
def chromium() -> Iterator[object]:
    """A headless Chromium for this folder alone, as others start their own; without one no walk is run, and says so."""
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed: no walk in a browser")
    from tools.page import served

    try:
        with served.chromium() as browser:
            yield browser
    except served.NoBrowserError as error:
        pytest.skip(f"no walk in a browser: {error}")


@pytest.fixture
def visit(chromium, server) -> Iterator[Callable[[], object]]:
    """Opens the page in a browser of its own: another visitor each time. Nothing may go wrong in any of them."""
    contexts, errors, elsewhere = [], [], []

    def come():
        context = chromium.new_context(viewport={"width": WIDTHS[0], "height": 900}, accept_downloads=True)
        context.set_default_timeout(PATIENCE_MS)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        page.on("request", lambda one: elsewhere.append(one.url) if not _ours(one.url, server) else None)
        page.goto(server)
        page.get_by_text("Your own").wait_for()
        return page

    yield come
    for context in contexts:
        context.close()
    assert errors == []
    assert elsewhere == [], "something was requested from another host"


def laid_out(page) -> None:
    """Nothing overlaps or sticks out, and every axis has its unit, at every width, by day and by night."""
    for _ in ("light", "dark"):
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            page.wait_for_timeout(600)  # charts follow the width
            assert page.evaluate(LAID_OUT) == []
        turn = page.locator("nav").get_by_role("button").last
        other = {"dark": "light", "light": "dark"}[turn.inner_text().split()[-1]]
        turn.click()
        page.locator("nav").get_by_role("button", name=other).wait_for()  # the whole page is shown anew before it
        page.wait_for_timeout(600)
    page.set_viewport_size({"width": WIDTHS[0], "height": 900})


def _ours(url: str, server: str) -> bool:
    return url.startswith((server, server.replace("http:", "ws:"), "data:", "blob:"))


def quiet(text: str, part: object = None) -> None:
    """Nobody listens."""


@pytest.fixture(scope="package")
def recording():
    """Four minutes of the drive with the hidden slope."""
    pytest.importorskip("nicegui", reason="the extra workbench is not installed")
    from cruise.workbench.examples import EXAMPLES, drive

    return drive(replace(EXAMPLES[0], seconds=240.0))


@pytest.fixture(scope="package")
def begun(recording):
    """The model before."""
    from cruise.workbench.found import Question
    from cruise.workbench.session import MODEL
    from cruise.workbench.verbs import compared

    return compared([recording], Question(MODEL), quiet)


@pytest.fixture(scope="package")
def better(recording, tmp_path_factory):
    """The model with the slope."""
    from cruise.workbench.found import Question
    from cruise.workbench.session import MODEL
    from cruise.workbench.verbs import added

    return added([recording], Question(MODEL), "grade", tmp_path_factory.mktemp("models") / "better.yaml", quiet)


@pytest.fixture
def session(recording, begun, better, tmp_path):
    """A session in which the slope was added."""
    from cruise.service.recordings import ReadingSettings
    from cruise.workbench.found import Opened, Question, Source
    from cruise.workbench.session import MODEL, Session, Step
    from cruise.workbench.setup import Setup

    one = Session(Setup(ReadingSettings(), CONFIG, tmp_path))
    source = Source((Path("monday's drive.csv"),), ReadingSettings(), "<b>monday</b>")
    one.opened = Opened(source, (recording,), ())
    one.steps = [
        Step(MODEL, Question(MODEL), begun),
        Step("+ grade", Question(str(better.path)), better.compared, better),
    ]
    one.at = 1
    yield one
    one.close()
    assert not one.folder.exists()
