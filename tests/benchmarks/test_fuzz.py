"""Every reader and every file that is loaded, damaged at random, a few times each."""

import importlib
import random
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
fuzz = importlib.import_module("fuzz")
TARGETS = fuzz.targets()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", TARGETS)
def test_damaged_files_are_read_or_refused(tmp_path, name):
    assert fuzz.fuzz(TARGETS[name], tmp_path, 1.0, random.Random(0), most=15) == []


def test_what_is_damaged_is_damaged():
    rng = random.Random(0)
    whole = bytes(range(256))
    assert sum(fuzz.damaged(whole, rng) != whole for _ in range(100)) > 90
    assert fuzz.damaged(b"", rng) is not None
