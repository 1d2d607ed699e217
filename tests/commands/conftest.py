from tests.commands.quick import quick

__all__ = ["quick"]
