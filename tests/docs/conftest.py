"""The documentation is tried with quick fits and small figures, which end with this package."""

from tests.cli.conftest import flight
from tests.commands.quick import quick

__all__ = ["flight", "quick"]
