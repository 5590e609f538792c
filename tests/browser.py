"""A headless Chromium, for tests of pages; they are skipped where it or Selenium is missing."""

import contextlib
from collections.abc import Generator
from typing import Any

import pytest


@contextlib.contextmanager
def headless_chromium() -> Generator[Any]:
    """Give a browser that keeps what its console and its network say."""
    webdriver = pytest.importorskip("selenium.webdriver")
    failed = pytest.importorskip("selenium.common").WebDriverException
    options = webdriver.ChromeOptions()
    for each in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1400,1200"):
        options.add_argument(each)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    try:
        made = webdriver.Chrome(options=options)
    except failed as error:
        pytest.skip(f"no Chromium: {error.msg}")
    made.set_script_timeout(600)
    try:
        yield made
    finally:
        made.quit()
