"""Texture: the structure tensor of image k-1, its eigenvalues and eigenbasis (paper, Sec. II-C)."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.image import _kernels
from flowlik.image.sampling import bilinear
from flowlik.support.arrays import Array
from flowlik.support.threads import in_bands

ROWS = 90
TENSORS = 60_000
POINTS = 1_000

Gradients = tuple[NDArray[np.int16], NDArray[np.int16]]
"""32 times the derivatives (H, W) of an image along u and v, as `derivatives` gives them."""


@dataclass(frozen=True)
class TextureDefinition:
    """What "texture" means to a likelihood; it belongs to the model file.

    The tensor is the *mean* over a square window of products of image derivatives, so that its
    eigenvalues t1 >= t2 >= 0 are in intensity^2/pixel^2 whatever the window.

    Parameters
    ----------
    derivative : str
        ``"scharr"``: 3x3 Scharr derivatives divided by 32 (a unit ramp gives 1).
    window : int
        Side of the box window [px], odd.

    Raises
    ------
    DataError
        If the derivative is unknown, or the window is even or not positive.
    """

    derivative: str = "scharr"
    window: int = 5

    def __post_init__(self) -> None:
        if self.derivative != "scharr":
            raise DataError(f"unknown image derivative {self.derivative!r}: known is 'scharr'")
        if self.window < 1 or self.window % 2 == 0:
            raise DataError(f"texture window must be odd and positive, not {self.window}")

    def describe(self) -> dict[str, str | int]:
        """Return the definition as it is written to model files."""
        return asdict(self)


def derivatives(image: NDArray[np.uint8]) -> Gradients:
    """32 times the Scharr derivatives [intensity/px] of a grey image (H, W) along u and v, exact."""
    gx, gy = (cv2.Scharr(image, cv2.CV_16S, dx, dy) for dx, dy in ((1, 0), (0, 1)))
    return gx, gy  # type: ignore[return-value]


def structure_tensor(image: NDArray[np.uint8], definition: TextureDefinition | None = None) -> Array:
    """Structure tensor (H, W, 3) = (Sxx, Sxy, Syy) [intensity^2/px^2] of a grey image (H, W).

    Borders are mirrored (BORDER_REFLECT_101).

    Raises
    ------
    DataError
        If the image is not a two-dimensional uint8 array of at least the window's size.
    """
    definition = definition or TextureDefinition()
    _check(image, definition)
    half = definition.window // 2
    gx, gy = (
        cv2.copyMakeBorder(g, half, half, half, half, cv2.BORDER_REFLECT_101) for g in derivatives(image)
    )
    S = np.empty((*image.shape, 3))
    in_bands(
        lambda first, last: _kernels.box_products(gx, gy, definition.window, first, last, S), len(S), ROWS
    )
    return S


def tensors_at(
    image: NDArray[np.uint8], pixels: Array, definition: TextureDefinition, gradients: Gradients | None = None
) -> Array:
    """Structure tensors (N, 3) at sub-pixel positions (N, 2), as `sample_tensor` gives them, to the bit.

    Where they are few, only what lies around them is summed up. ``gradients`` are the image's `derivatives`,
    where they are known.

    Raises
    ------
    DataError
        If the image is not a two-dimensional uint8 array of at least the window's size.
    """
    _check(image, definition)
    if len(pixels) * (definition.window + 1) ** 2 > image.size or min(image.shape) < 2:
        return sample_tensor(structure_tensor(image, definition), pixels)
    gx, gy = gradients or derivatives(image)
    pixels = np.ascontiguousarray(pixels, dtype=np.float64)
    S = np.empty((len(pixels), 3))
    in_bands(
        lambda first, last: _kernels.tensors_at(gx, gy, pixels, definition.window, first, last, S),
        len(S),
        POINTS,
    )
    return S


def _check(image: NDArray[np.uint8], definition: TextureDefinition) -> None:
    if image.dtype != np.uint8 or image.ndim != 2:
        raise DataError(f"an image must be grey uint8 (H, W), not {image.dtype} {image.shape}")
    if min(image.shape) < definition.window:
        raise DataError(f"image of {image.shape} is smaller than the texture window {definition.window}")


def eigenbasis(S: Array) -> tuple[Array, Array]:
    """Eigenvalues and eigenbasis of structure tensors; ``S = R_i_e diag(t) R_e_i``.

    Parameters
    ----------
    S : array (..., 3)
        (Sxx, Sxy, Syy).

    Returns
    -------
    t : array (..., 2)
        t1 >= t2 >= 0 [intensity^2/px^2].
    R_i_e : array (..., 2, 2)
        Rotation whose columns are e1, e2 in {i}; the identity where S is isotropic.
    """
    flat = np.ascontiguousarray(S, dtype=np.float64).reshape(-1, 3)
    t, R_i_e = np.empty((len(flat), 2)), np.empty((len(flat), 2, 2))
    in_bands(lambda first, last: _kernels.eigen_2x2(flat, first, last, t, R_i_e), len(flat), TENSORS)
    return t.reshape(*S.shape[:-1], 2), R_i_e.reshape(*S.shape[:-1], 2, 2)


def sample_tensor(S: Array, pixels: Array) -> Array:
    """Structure tensors (N, 3) at sub-pixel positions (N, 2): bilinear in S, clamped to the image.

    Interpolating S keeps it positive semi-definite; eigenvectors must never be interpolated.
    """
    return bilinear(S, pixels)
