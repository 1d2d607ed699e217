"""No function is longer than 80 lines, nor takes more than 8 parameters; what does holds two ideas."""

import ast
from pathlib import Path

import pytest

import flowlik

SOURCE = Path(flowlik.__file__).parent
LONGEST, MOST = 80, 8
KERNELS = {"njit", "kernel", "inlined"}
EXCEPTIONS = {
    "simulation.flight._scenario.simulate": "what a script says of a flight in one line, by keyword",
}
"""Functions that are longer, or take more, and why. Numba's kernels and typer's commands need no entry."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def functions(tree: ast.AST, inside: str = ""):
    """Functions of a module with their names, methods and nested ones too."""
    for node in ast.iter_child_nodes(tree):
        name = f"{inside}{node.name}" if isinstance(node, Function | ast.ClassDef) else inside
        if isinstance(node, Function):
            yield name, node
        yield from functions(node, f"{name}." if isinstance(node, Function | ast.ClassDef) else inside)


def parameters(function: Function) -> list[str]:
    """Parameters but for `self`, `cls` and starred ones."""
    given = function.args
    names = [a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return names[1:] if names[:1] in (["self"], ["cls"]) else names


def left_out(module: str, name: str, function: Function) -> bool:
    """Whether it is a command of typer, whose options are parameters, or a kernel, which takes no objects."""
    decorators = {ast.unparse(d).partition("(")[0] for d in function.decorator_list}
    kernel = bool(decorators & KERNELS)
    return kernel or (module.startswith("cli.") and name == "run")


def over(function: Function) -> bool:
    return function.end_lineno - function.lineno + 1 > LONGEST or len(parameters(function)) > MOST


OVER = {
    f"{module}.{name}"
    for path in sorted(SOURCE.rglob("*.py"))
    for module in [".".join(path.relative_to(SOURCE).with_suffix("").parts)]
    for name, function in functions(ast.parse(path.read_text(encoding="utf-8")))
    if over(function) and not left_out(module, name, function)
}


def test_functions_are_short_and_take_few_parameters():
    assert not OVER - EXCEPTIONS.keys()


def test_no_exception_stands_without_need():
    assert not EXCEPTIONS.keys() - OVER


@pytest.mark.parametrize(
    ("lines", "parameters", "expected"),
    [(LONGEST, MOST, False), (LONGEST + 1, MOST, True), (LONGEST, MOST + 1, True)],
)
def test_what_is_over_is_found(lines, parameters, expected):
    names = ", ".join(f"a{i}" for i in range(parameters))
    code = f"class A:\n  @decorated\n  def f(self, {names}, *rest, **others):\n" + "    pass\n" * (lines - 1)
    ((name, function),) = functions(ast.parse(code))
    assert name == "A.f"
    assert over(function) is expected
