"""Commands whose help says nothing of the type of a flag."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand, TyperGroup


class Command(TyperCommand):
    """Command whose flags are shown without a type: to say ``<bool>`` of one helps nobody."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Parameters, the help option among them."""
        return _untyped(super().get_params(ctx))


class Group(TyperGroup):
    """Group of such commands."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Parameters, the help option among them."""
        return _untyped(super().get_params(ctx))


def _untyped(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        if getattr(parameter, "is_flag", False) and parameter.metavar is None:
            parameter.metavar = ""
    return parameters
