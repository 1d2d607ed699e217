"""A road with everything beside it, along any route."""
