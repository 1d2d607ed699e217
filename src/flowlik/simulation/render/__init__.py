"""From shapes, materials and daylight to pictures with exact depth."""

from flowlik.simulation.render._daylight import Daylight
from flowlik.simulation.render._materials import Layer, Material, Surface
from flowlik.simulation.render._meshes import box, lattice, quad, tube
from flowlik.simulation.render._prototypes import Foliage, Instances, LeafShape, Mesh, Prototype, placed
from flowlik.simulation.render._raster.packed import Shapes, pack_shapes
from flowlik.simulation.render._scene import FAR_M, Scene, bounding_spheres, clearance

__all__ = [
    "FAR_M",
    "Daylight",
    "Foliage",
    "Instances",
    "Layer",
    "LeafShape",
    "Material",
    "Mesh",
    "Prototype",
    "Scene",
    "Shapes",
    "Surface",
    "bounding_spheres",
    "box",
    "clearance",
    "lattice",
    "pack_shapes",
    "placed",
    "quad",
    "tube",
]
