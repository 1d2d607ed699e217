"""Synthetic cameras, images, likelihoods and measurements with known truth."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.egomotion import Epipolar, KnownDepth, Residual
from flowlik.geometry.camera import Pinhole
from flowlik.geometry.motion import exp_se3, h, inverse_range
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.families import LaplaceCauchy
from flowlik.likelihood.likelihood import FlowLikelihood
from flowlik.likelihood.schedule import Index, Schedule
from flowlik.measurement.measurements import Measurements

CAMERA = Pinhole(640, 480, 400.0, 420.0, 311.0, 245.5)

# a table such as planes give: a broad core at low texture, a sharp one at high texture
KNOTS = np.log(10) * np.array([-1.0, 0.5, 2.0, 3.5])
LCM_VALUES = np.array(
    [
        2 / np.pi * np.arctan([1.0, 3.0, 15.0, 40.0]),  # beta, of lambda [1/px]
        [2.0, 0.8, 0.2, 0.05],  # gamma [px]
        [0.5, 0.6, 0.7, 0.8],  # w_L
    ]
)


def lcm_likelihood(**fields) -> FlowLikelihood:
    """Laplace-Cauchy likelihood over ln t, of any flow method unless told."""
    return FlowLikelihood(LaplaceCauchy(), Schedule(Index(), KNOTS, LCM_VALUES), **fields)


def finite_difference(f: Callable, x: np.ndarray, step: float) -> np.ndarray:
    """Central differences of f along every element of x, stacked on the last axis."""
    return np.stack(
        [(f(x + step * e) - f(x - step * e)) / (2 * step) for e in np.eye(len(x))],
        axis=-1,
    )


def random_motion(rng: np.random.Generator, degrees: float = 2.0, metres: float = 0.3) -> RigidTransform:
    """Motion with a rotation and a translation of the given sizes in random directions."""
    directions = rng.standard_normal((2, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return exp_se3(np.concatenate([np.deg2rad(degrees) * directions[0], metres * directions[1]]))


def tangent_error(T: RigidTransform, truth: RigidTransform) -> np.ndarray:
    """Tangent (6,) of the left perturbation that takes the truth to T."""
    return (T * truth.inv()).as_exp_coords()


def textured_image(shape: tuple[int, int], seed: int = 0, shift=(0.0, 0.0)) -> np.ndarray:
    """Sum of random waves, moved by exactly `shift` (u, v) [px]; grey uint8."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0 : shape[0], 0 : shape[1]].astype(float)
    wave, phase = rng.uniform(-0.35, 0.35, (40, 2)), rng.uniform(0, 2 * np.pi, 40)
    waves = [np.sin(a * (u - shift[0]) + b * (v - shift[1]) + p) for (a, b), p in zip(wave, phase)]
    return np.clip(np.rint(128 + 12 * np.sum(waves, axis=0)), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Scene:
    """Flow vectors of a known motion, with their depth [m] along z."""

    T: RigidTransform
    measurements: Measurements
    depth: np.ndarray

    @property
    def known_depth(self) -> KnownDepth:
        return KnownDepth.of(self.measurements, CAMERA, self.depth)

    @property
    def epipolar(self) -> Epipolar:
        return Epipolar.of(self.measurements, CAMERA)


def make_scene(
    T: RigidTransform,
    rng: np.random.Generator,
    n: int = 400,
    likelihood: FlowLikelihood | None = None,
    outliers: float = 0.0,
    depth_of: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Scene:
    """Random pixels, depths (2 to 20 m, or those of rays), textures and eigenbases; exact flow of a motion.

    To it come errors drawn from a likelihood, and errors of up to 40 px on a share of the vectors.
    """
    pixels = rng.uniform([0, 0], [CAMERA.width - 1, CAMERA.height - 1], (n, 2))
    depth = rng.uniform(2, 20, n) if depth_of is None else depth_of(CAMERA.rays(pixels))
    angle = rng.uniform(0, np.pi, n)
    R_i_e = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=-1).reshape(-1, 2, 2)
    texture = np.sort(10 ** rng.uniform(-1, 3.5, (n, 2)), axis=1)[:, ::-1]
    flow = h(T, CAMERA, pixels, inverse_range(CAMERA, pixels, depth))
    if likelihood is not None:
        z = likelihood.sample(np.log(texture), rng)
        flow = flow + np.einsum("nij,nj->ni", R_i_e, z)
    gross = rng.choice(n, int(outliers * n), replace=False)
    flow[gross] += rng.uniform(-40, 40, (len(gross), 2))
    measurements = Measurements(pixels, flow, R_i_e, texture, TextureDefinition(), {"name": "synthetic"})
    return Scene(T, measurements, depth)


def normalised(residual: Residual, T: np.ndarray) -> np.ndarray:
    """Motion (3, 4) with what the residual does not observe set by its convention."""
    return residual.retract(T, np.zeros(6))


def each_of(residual: Residual) -> int:
    """Components that a residual has of a vector."""
    return 2 if residual.metric else 1


def support_bounds(residual: Residual, bound, index: Index, kept: np.ndarray) -> np.ndarray:
    """Bounds by which support is counted of kept eigen-components (N, 2)."""
    bounds = residual.sampling.bounds(bound, index)
    return np.where(residual.sampling.components(kept)[:, None], bounds, -1.0)
