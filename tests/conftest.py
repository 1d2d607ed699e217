"""Fixtures shared by all tests."""

import os
from contextlib import suppress
from pathlib import Path

import pytest

# read when numpy is first imported: threads of its algebra would spin on the core of the other worker
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_addoption(parser):
    """Without pytest-xdist its options, which pyproject.toml gives, change nothing."""
    for option in ("--numprocesses", "--maxprocesses", "--dist"):
        with suppress(ValueError):  # it is there
            parser.addoption(option)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of public data sets used by some tests; those tests are skipped where it is absent."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("FLOWLIK_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder} (set FLOWLIK_DATA)")
    return folder
