"""The page as a browser shows it, where there is one: `benchmarks/page.py`."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
page = pytest.importorskip("page", reason="the benchmarks are not beside the tests")


def test_nothing_is_wrong_in_a_browser(built):
    """First screen, folding, nothing broken or too wide, on a phone and a desktop, light and dark."""
    if (program := page.browser()) is None:
        pytest.skip("no Chromium is installed")
    assert page.check(program, (built / "report.html").resolve()) == []
