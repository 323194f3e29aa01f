"""Fixtures of the report's tests."""

import pytest
from support.browser import browser, browser_program


@pytest.fixture(scope="session")
def tab(tmp_path_factory):
    """A tab of a headless browser."""
    path = browser_program()
    if path is None:
        pytest.skip("no Chromium is installed; `apt-get install chromium` brings one")
    with browser(path, tmp_path_factory.mktemp("browser")) as opened:
        yield opened
