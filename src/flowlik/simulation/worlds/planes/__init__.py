"""A closed hall with rectangles in it, textured or patterned."""
