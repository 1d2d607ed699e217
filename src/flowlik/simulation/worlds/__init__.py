"""The worlds, one folder each. None imports another."""
