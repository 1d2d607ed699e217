"""How good motions and trajectories are."""
