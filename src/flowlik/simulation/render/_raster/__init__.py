"""The rasteriser: triangles and leaves to pictures with exact depth, in compiled kernels.

`packed` lays a scene out in arrays; `_corners` and `_screen` take it to the screen; `_visibility` finds what
each of a pixel's samples sees; `_shading` gives it light, from `_texturing` and `_shadow`; `_tiles` puts the
picture together; `frame` runs them. `shadows` makes the shadow map, `distances` measures how far points are
from it all.
No fastmath, so that every machine computes the same; kernels release the interpreter's lock and run
on Python's threads.
"""
