"""The worlds, one folder each; `world` is its face. None imports another."""
