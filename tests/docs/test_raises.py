"""Docstrings name the errors that are raised, by the function itself and by what it calls.

Checked is whatever has no underscore: functions, methods, and classes, whose docstring speaks for their
properties and for what Python itself calls (`__post_init__`, `__getitem__`, …). Named must be a function's
own errors, and flowlik's errors in the functions that it calls directly: those of the same module, private
ones too, those imported from flowlik, and methods of `self`. What is caught on the way is not raised, nor
what stands in a nested function; a base stands for its subclasses. The command line is left out: there the
docstrings are the help, and `main` tells all errors.
"""

import ast
import builtins
import importlib
import inspect
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from functools import cached_property
from types import FunctionType
from typing import Any, get_type_hints

import pytest

import flowlik
from flowlik.errors import FlowlikError

LEFT_OUT = ("flowlik.cli", "flowlik.simulation", "flowlik.likelihood.")
MODULES = [
    m.name for m in pkgutil.walk_packages(flowlik.__path__, "flowlik.") if not m.name.startswith(LEFT_OUT)
]
SECTION = re.compile(r"^Raises\n-+\n(.*?)(?=^\w.*\n-+$|\Z)", re.MULTILINE | re.DOTALL)
Errors = set[type[BaseException]]


def errors_of(member: Any, owner: type | None, calls: bool = True) -> Errors:
    """Errors in the body of a function of flowlik, and with `calls` those of flowlik in what it calls."""
    for attribute in ("fget", "func", "__func__"):
        member = getattr(member, attribute, None) or member
    function = inspect.unwrap(member) if callable(member) else None
    if not isinstance(function, FunctionType) or not function.__module__.startswith("flowlik"):
        return Errors()
    if function.__code__.co_filename.startswith("<"):  # what dataclasses write
        return Errors()
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    names = {**vars(builtins), **function.__globals__, "self": owner, "cls": owner}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            source = importlib.import_module(node.module or "")
            names |= {a.asname or a.name: getattr(source, a.name, None) for a in node.names}

    def meaning(node: ast.expr | None) -> Any:
        if isinstance(node, ast.Attribute):
            return inspect.getattr_static(meaning(node.value), node.attr, None)
        return names.get(node.id) if isinstance(node, ast.Name) else None

    def escapes(error: type[BaseException], handlers: list[ast.excepthandler]) -> bool:
        for handler in handlers:
            kinds = map(meaning, getattr(handler.type, "elts", [handler.type]))
            if issubclass(error, tuple(kind for kind in kinds if isinstance(kind, type))):
                return any(isinstance(node, ast.Raise) and not node.exc for node in ast.walk(handler))
        return True

    nested = {n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)} - {*tree.body}

    def raised(node: ast.AST) -> Iterator[type[BaseException]]:
        if node in nested:
            return
        if isinstance(node, ast.Raise) and node.exc:
            error = meaning(node.exc.func if isinstance(node.exc, ast.Call) else node.exc)
            yield error if isinstance(error, type) else get_type_hints(error)["return"]
        if isinstance(node, ast.Call) and calls and not isinstance(called := meaning(node.func), type):
            yield from (e for e in errors_of(called, owner, calls=False) if issubclass(e, FlowlikError))
        for child in ast.iter_child_nodes(node):
            handlers = node.handlers if isinstance(node, ast.Try) and child in node.body else []
            yield from (error for error in raised(child) if escapes(error, handlers))

    return set(raised(tree))


def public() -> Iterator[tuple[str, str, Errors]]:
    """Name, docstring and errors of whatever has no underscore."""
    for module in map(importlib.import_module, MODULES):
        for name, thing in list(vars(module).items()):
            if name.startswith("_") or getattr(thing, "__module__", None) != module.__name__:
                continue
            owner = thing if isinstance(thing, type) else None
            of_thing = Errors()
            for member, value in vars(thing).items() if owner else [("__call__", thing)]:
                if member.startswith("__") or isinstance(value, property | cached_property):
                    of_thing |= errors_of(value, owner)
                elif not member.startswith("_"):
                    doc = inspect.getdoc(getattr(thing, member)) or ""
                    yield f"{module.__name__}.{name}.{member}", doc, errors_of(value, owner)
            yield f"{module.__name__}.{name}", inspect.getdoc(thing) or "", of_thing


@pytest.mark.parametrize(("name", "doc", "errors"), [case for case in public() if case[2]])
def test_the_errors_are_named(name, doc, errors):
    section = "".join(SECTION.findall(doc))
    bases = {error: [base.__name__ for base in error.__mro__ if base is not Exception] for error in errors}
    assert not {e for e, names in bases.items() if not any(re.search(rf"\b{n}\b", section) for n in names)}
