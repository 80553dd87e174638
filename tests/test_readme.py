"""What the pages for readers name is there: files, verbs of the command line, headings that a link points to."""

import re
from pathlib import Path

import pytest

from cruise.cli import VERBS

ROOT = Path(__file__).parents[1]
PAGES = sorted(page for page in ROOT.rglob("README.md") if not any(part.startswith(".") for part in page.parts))
PLACE = re.compile(r"(?:cruise|config|tests|tools|systemd)/[\w./*-]*[\w/]")
CODE = re.compile(r"`([^`\n]+)`|^ {4}(.+)$", re.MULTILINE)
PICTURE = re.compile(r"src(?:set)?=\"([^\"]+)\"")
HEADING = re.compile(r"\]\(#([\w-]+)\)")
LINK = re.compile(r"\]\(([\w./-]+)\)")
VERB = re.compile(r"(?:^|[&;/] ?)cruise ([a-z]+)")
WIDTH = 120


@pytest.fixture(params=PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def page(request) -> str:
    return request.param.read_text(encoding="utf-8")


def code_of(page: str) -> list[str]:
    return [one or other for one, other in CODE.findall(page)]


def test_there_are_pages():
    assert ROOT / "README.md" in PAGES
    assert len(PAGES) > 1


def test_every_file_named_is_there(page):
    named = {place for code in code_of(page) for place in PLACE.findall(code)} | set(PICTURE.findall(page))
    named |= set(LINK.findall(page))
    assert [place for place in sorted(named) if not any(ROOT.glob(place))] == []


def test_every_verb_named_is_one(page):
    assert {verb for code in code_of(page) for verb in VERB.findall(code)} <= set(VERBS)


def test_every_link_has_its_heading(page):
    headings = {line.lstrip("# ").lower().replace(" ", "-") for line in page.splitlines() if line.startswith("#")}
    assert set(HEADING.findall(page)) <= headings


def test_no_line_is_too_long(page):
    free = ("|", "    ", "  <")  # tables, what is typed, and pictures
    assert [line for line in page.splitlines() if len(line) > WIDTH and not line.startswith(free)] == []
