"""Files, threads, progress, extras and the array type: what every room may use."""
