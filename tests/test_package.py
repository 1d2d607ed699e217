"""The package as a newcomer imports it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import flowlik


@pytest.mark.parametrize("name", flowlik.__all__)
def test_every_public_name_loads(name):
    assert getattr(flowlik, name).__name__ == name


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nonsense"):
        _ = flowlik.nonsense


def test_importing_loads_nothing_heavy():
    code = "import flowlik, sys; print(sorted({'cv2', 'numba', 'scipy', 'matplotlib'} & set(sys.modules)))"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert printed.strip() == "[]"


def test_nothing_is_pickled_to_files():
    """Processes may exchange objects; files hold none."""
    for path in Path(flowlik.__file__).parent.rglob("*.py"):
        text = path.read_text()
        assert "import pickle" not in text
        assert "allow_pickle=True" not in text


def test_importing_takes_less_than_a_second():
    code = "import time; start = time.process_time(); import flowlik; print(time.process_time() - start)"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert float(printed) < 1.0
