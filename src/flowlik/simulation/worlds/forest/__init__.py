"""Trees, undergrowth, rocks and houses beside a track."""
