"""The package as a newcomer imports it."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import flowlik

ROOMS = [
    "flowlik",
    *(f"flowlik.{room.name}" for room in pkgutil.iter_modules(flowlik.__path__) if room.ispkg),
]
PUBLIC = [(room, name) for room in ROOMS for name in getattr(importlib.import_module(room), "__all__", ())]


@pytest.mark.parametrize(("room", "name"), PUBLIC)
def test_every_public_name_loads(room, name):
    assert hasattr(importlib.import_module(room), name)


@pytest.mark.parametrize("room", ["flowlik", "flowlik.commands", "flowlik.likelihood"])
def test_type_checkers_see_the_names_that_load_on_first_use(room):
    tree = ast.parse(Path(importlib.import_module(room).__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {alias.asname: f"{node.module}.{alias.name}" for node in block.body for alias in node.names}
    assert sorted(seen) == importlib.import_module(room).__all__
    for name, place in seen.items():
        assert pkgutil.resolve_name(place) is getattr(importlib.import_module(room), name)


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
