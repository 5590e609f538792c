"""A headless Chromium, for tests of pages; they are skipped where Selenium is not installed."""

import contextlib
from collections.abc import Iterator
from typing import Any

import pytest


@contextlib.contextmanager
def headless_chromium() -> Iterator[Any]:
    """Give a browser that keeps what its console and its network say."""
    webdriver = pytest.importorskip("selenium.webdriver")
    options = webdriver.ChromeOptions()
    for each in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1400,1200"):
        options.add_argument(each)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    made = webdriver.Chrome(options=options)
    made.set_script_timeout(600)
    try:
        yield made
    finally:
        made.quit()
