"""flowlik: honest error distributions for optical flow."""
