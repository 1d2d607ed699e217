"""Fixtures shared by all tests."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of public data sets used by some tests; those tests are skipped where it is absent."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("FLOWLIK_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder} (set FLOWLIK_DATA)")
    return folder
