"""How well a likelihood describes errors."""
