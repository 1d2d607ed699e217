"""What a pair of images says: flow vectors with their texture and other signals."""
