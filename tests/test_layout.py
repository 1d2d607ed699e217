"""The order of the rooms: a module imports nothing to its right, and no two modules import each other."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import flowlik

SOURCE = Path(flowlik.__file__).parent
ROOMS = """errors support geometry results image datasets flow measurement likelihood calibration egomotion
    odometry evaluation comparison report simulation commands cli"""
MODULES = {".".join(path.relative_to(SOURCE).with_suffix("").parts): path for path in SOURCE.rglob("*.py")}


def imported(path: Path) -> set[str]:
    """Modules of flowlik that a file imports anywhere, as keys of MODULES."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {(f"{node.module}.{alias.name}", node.module) for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {(alias.name, alias.name) for alias in node.names}
    return {module for pair in names if (module := first_known(*pair))}


def first_known(*names: str) -> str | None:
    own = [name.removeprefix("flowlik.") for name in names if name.startswith("flowlik.")]
    return next((m for name in own for m in (name, f"{name}.__init__") if m in MODULES), None)


IMPORTS = {module: imported(path) for module, path in MODULES.items()}


def test_no_module_imports_to_its_right():
    place = {room: i for i, room in enumerate(ROOMS.split())}
    upward = [
        f"{module} imports {other}"
        for module, others in IMPORTS.items()
        for other in others
        if module != "__init__" and place[other.split(".")[0]] > place[module.split(".")[0]]
    ]
    assert not upward


def test_no_modules_import_each_other():
    assert list(TopologicalSorter(IMPORTS).static_order())


def test_only_commands_import_the_simulation():
    outside = [m for m, others in IMPORTS.items() if any(o.startswith("simulation") for o in others)]
    assert {m.split(".")[0] for m in outside} <= {"simulation", "commands", "cli"}


def test_no_loose_modules():
    assert {m for m in MODULES if "." not in m} == {"__init__", "errors"}
