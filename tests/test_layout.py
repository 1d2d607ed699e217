"""The order of the rooms: a module imports nothing to its right, and no two modules import each other."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import flowlik

SOURCE = Path(flowlik.__file__).parent
ROOMS = """errors support geometry results image datasets flow measurement likelihood calibration egomotion
    odometry self_supervision fusion evaluation comparison report simulation commands cli"""
WINGS = "_base _noise render things worlds flight inertial __init__"  # of the simulation, and its face
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


def upward(order: str, inside: str) -> list[str]:
    """Imports of something further right, by the names that follow `inside` in those of modules."""
    place = {name: i for i, name in enumerate(order.split())}

    def place_of(module: str) -> int:
        return place[module.removeprefix(inside).split(".")[0]]

    return [
        f"{module} imports {other}"
        for module, others in IMPORTS.items()
        for other in others
        if module.startswith(inside) and other.startswith(inside) and place_of(other) > place_of(module)
    ]


def test_no_module_imports_to_its_right():
    assert not upward(f"{ROOMS} __init__", "")


def test_no_wing_of_the_simulation_imports_to_its_right():
    assert not upward(WINGS, "simulation.")


def test_no_world_imports_another():
    worlds = {m: m.split(".")[2] for m in IMPORTS if m.startswith("simulation.worlds.") and m.count(".") > 2}
    assert set(worlds.values()) == {"forest", "driving", "planes"}
    assert not [m for m, w in worlds.items() for o in IMPORTS[m] if worlds.get(o, w) != w]


def test_what_has_an_underscore_is_imported_in_its_own_folder_only():
    strangers = []
    for module, others in IMPORTS.items():
        for parts in (other.split(".") for other in others):
            private = [i for i, part in enumerate(parts) if part.startswith("_") and part != "__init__"]
            if any(module.split(".")[:i] != parts[:i] for i in private):
                strangers.append(f"{module} imports {'.'.join(parts)}")
    assert not strangers


def test_no_modules_import_each_other():
    assert list(TopologicalSorter(IMPORTS).static_order())


def test_only_commands_import_the_simulation():
    outside = [m for m, others in IMPORTS.items() if any(o.startswith("simulation") for o in others)]
    assert {m.split(".")[0] for m in outside} <= {"__init__", "simulation", "commands", "cli"}


def test_no_loose_modules():
    assert {m for m in MODULES if "." not in m} == {"__init__", "errors"}
