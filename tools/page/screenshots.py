"""Draws every view of the workbench, light and dark, 1440 and 1024 wide, and the pictures of the README.

The walk is that of the tests: the bundled recording with the hidden effect, what is missing, the effect added, and the
virtual combine watched for half a minute.
"""

import io
import os
from pathlib import Path
from typing import Annotated, Final

import typer
from PIL import Image
from playwright.sync_api import Page

from .served import ROOT, chromium, served

WIDTHS: Final = (1440, 1024)
HEIGHT: Final = 900
PICTURES: Final = ROOT / "tools" / "pictures"  # of the README
PICTURE_WIDTH, QUALITY = 1200, 80  # about 60 kB each
BEFORE: Final = ("Where it fails", "What is missing", "Live")  # shown before the effect is added
AFTER: Final = ("Open", "Compare", "Add", "Take away")
PATIENCE_MS: Final = 600_000
WATCHED_MS: Final = 30_000
STILL_MS: Final = 2500  # for fonts and charts


def main(
    folder: Annotated[
        Path, typer.Argument(help="Where all views go; the pictures of the README go to tools/pictures.")
    ] = ROOT / "out" / "screenshots",
) -> None:
    """Draw every view of the workbench, light and dark, wide and narrow, and the pictures of the README."""
    folder.mkdir(parents=True, exist_ok=True)
    PICTURES.mkdir(exist_ok=True)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    with served(cache, folder / "said.txt") as address, chromium() as browser:
        size = {"width": WIDTHS[0], "height": HEIGHT}
        page = browser.new_context(viewport=size, color_scheme="light").new_page()  # pyright: ignore[reportArgumentType]
        page.set_default_timeout(PATIENCE_MS)
        page.goto(address)
        _walk(page)
        _draw(page, BEFORE, folder)
        _add(page)
        _draw(page, AFTER, folder)


def _go(page: Page, name: str) -> None:
    """To a view, until it stands still."""
    page.locator("nav").get_by_text(name, exact=True).click()
    page.locator("nav [aria-current=page]", has_text=name).wait_for()
    page.locator("main [role=heading]", has_text=name).first.wait_for()
    page.wait_for_timeout(STILL_MS)


def _walk(page: Page) -> None:
    """Do everything that the views show."""
    page.get_by_text("Your own").wait_for()
    page.locator('[data-example="sometimes-slow"]').click()
    page.get_by_text("How good, and how good at best").wait_for()
    page.locator(".dock").wait_for(state="hidden")
    _go(page, "What is missing")
    page.get_by_role("button", name="What is missing?").click()
    page.locator("[data-verdict]").wait_for()
    _go(page, "Live")
    page.get_by_text("Watch the combine").click()
    page.wait_for_timeout(WATCHED_MS)
    page.get_by_text("Stop watching").click()


def _add(page: Page) -> None:
    """Add what was missing."""
    _go(page, "What is missing")
    page.locator("[data-add]").first.click()
    page.get_by_text("held-out error of this step").wait_for()
    page.locator(".dock").wait_for(state="hidden")


def _draw(page: Page, names: tuple[str, ...], folder: Path) -> None:
    """These views, by both lights and in both widths."""
    for light in ("light", "dark"):
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": HEIGHT})
            for name in names:
                _go(page, name)
                word = name.lower().replace(" ", "-")
                page.screenshot(path=folder / f"{word}-{width}-{light}.png", full_page=True)
                if width == WIDTHS[0]:
                    _keep(page.screenshot(), PICTURES / f"{word}{'-dark' if light == 'dark' else ''}.webp")
        page.locator("nav").get_by_role("button").last.click()
        page.locator("nav").get_by_role("button", name="light" if light == "light" else "dark").wait_for()
        page.wait_for_timeout(STILL_MS)


def _keep(png: bytes, path: Path) -> None:
    """A picture of the README: what one sees without scrolling, small."""
    seen = Image.open(io.BytesIO(png)).convert("RGB")
    height = round(PICTURE_WIDTH * seen.height / seen.width)
    seen.resize((PICTURE_WIDTH, height), Image.Resampling.LANCZOS).save(path, "WEBP", quality=QUALITY, method=6)


if __name__ == "__main__":
    typer.run(main)
