"""The site of the docs, opened from a folder without a server and without a network: it can be searched."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.browser.chromium import MissingBrowserError, opened, wait_until

pytestmark = pytest.mark.browser
REPO = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as `make docs` builds it."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-d", str(folder)]
    subprocess.run(command, cwd=REPO, check=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"})
    return folder


def test_no_page_loads_anything_from_elsewhere(site: Path) -> None:
    """No script, style, picture or font of any page has the address of a host."""
    loads = re.compile(r"<(?:script|link|img|iframe)[^>]*?(?:src|href)=\"?(https?:)?//", re.I)
    pages = sorted(site.rglob("*.html"))

    assert len(pages) > 30
    assert [] == [page.name for page in pages if loads.search(page.read_text("utf-8"))]


def test_the_search_works_from_a_folder(site: Path) -> None:
    """A word of the alarms' page leads to it, on file://."""
    try:
        browser = opened()
    except MissingBrowserError as error:
        pytest.skip(str(error))
    with browser as page:
        page.get((site / "index.html").as_uri())
        field = page.find_element("css selector", "input.md-search__input")
        wait_until("the field takes words", field.is_displayed)
        field.click()
        field.send_keys("deflation")
        found = "a.md-search-result__link"
        wait_until("results", lambda: bool(page.find_elements("css selector", found)))
        links = [one.get_attribute("href") for one in page.find_elements("css selector", found)]

    assert any("explanation/alarms.html" in link for link in links)
