"""`flowlik doctor`: what is installed, what is missing, and whether it works."""

from __future__ import annotations

import os
import platform
import sys
import time
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from flowlik.datasets.next_frame import true_flow
from flowlik.egomotion import KnownDepth, lcmsac
from flowlik.errors import FlowlikError
from flowlik.flow import flow_method
from flowlik.geometry.camera import Pinhole
from flowlik.image.sampling import at_nearest
from flowlik.likelihood.model_file import load_likelihood
from flowlik.likelihood.shipped import shipped
from flowlik.measurement.measurements import measure
from flowlik.support.extras import EXTRAS, missing
from flowlik.support.threads import THREADS
from flowlik.support.versions import versions

MODEL = "lucas-kanade"
CAMERA = Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)
MOVE = RigidTransform.from_translation([-0.06, 0.02, 0.0])
DEPTH_M = 4.0
WAVES = 60


@dataclass(frozen=True)
class Check:
    """One thing that was tried.

    Attributes
    ----------
    name : str
        What.
    passed : bool
        Whether it went well.
    found : str
        What came out, or what went wrong.
    seconds : float
        How long it took.
    """

    name: str
    passed: bool
    found: str
    seconds: float


@dataclass(frozen=True)
class Examination:
    """What `doctor` found.

    Attributes
    ----------
    versions : dict
        Of Python and what results depend on.
    system : dict
        Machine, cores, terminal.
    extras : dict
        By extra: the packages that are missing, none if it is installed.
    checks : list of Check
        The self-test.
    """

    versions: dict[str, str]
    system: dict[str, str]
    extras: dict[str, list[str]]
    checks: list[Check]

    @property
    def healthy(self) -> bool:
        """Whether all checks passed; a missing extra is no illness."""
        return all(check.passed for check in self.checks)


def doctor() -> Examination:
    """Look at the installation and try it on a scene of known motion, in a few seconds.

    The first time takes longer: kernels are compiled.
    """
    system = {
        "machine": f"{platform.system()} {platform.machine()}",
        "python": sys.executable,
        "cores": f"{THREADS} usable of {os.cpu_count()}",
    }
    return Examination(versions(), system, {name: missing(name) for name in EXTRAS}, list(_checks()))


def _checks() -> list[Check]:
    found = []
    likelihoods = _timed("shipped models", lambda: f"{len([load_likelihood(n) for n in shipped()])} load")
    found.append(likelihoods)
    try:
        first, second, h = _scene()
        likelihood = load_likelihood(MODEL)
        m = measure(first, second, flow_method(MODEL), likelihood.texture, signals=likelihood.signals)
    except Exception as error:
        return [*found, Check("flow", False, f"{type(error).__name__}: {error}", 0.0)]

    def flow() -> str:
        z = m.errors(at_nearest(h, m.pixels))
        inside = float((np.abs(z) <= likelihood.bound(likelihood.coordinate(m), 0.9)).mean())
        median_px = float(np.median(np.abs(z)))
        if median_px > 0.2 or inside < 0.7:
            raise FlowlikError(f"median error {median_px:.3f} px, {inside:.0%} within the 90 % interval")
        return f"median error {median_px:.3f} px, {inside:.0%} within the 90 % interval"

    def motion() -> str:
        residual = KnownDepth.of(m, CAMERA, np.full((CAMERA.height, CAMERA.width), DEPTH_M))
        estimate = lcmsac(likelihood).estimate(residual)
        error_mm = 1000 * float(np.linalg.norm((estimate.T_k_prev * MOVE.inv()).translation))
        if not estimate.solved or error_mm > 5:
            raise FlowlikError(f"{estimate.status}, translation wrong by {error_mm:.2f} mm")
        return f"{estimate.status}, translation right to {error_mm:.2f} mm of 63 mm"

    return [*found, _timed("flow and its likelihood", flow), _timed("ego-motion", motion)]


def _timed(name: str, attempt: object) -> Check:
    assert callable(attempt)
    start = time.perf_counter()
    try:
        return Check(name, True, attempt(), time.perf_counter() - start)
    except FlowlikError as error:
        return Check(name, False, str(error), time.perf_counter() - start)
    except Exception as error:  # packages that do not fit one another fail in any way
        found = f"{type(error).__name__}: {error}"
        return Check(name, False, found, time.perf_counter() - start)


def _scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two images of a frontal plane painted with waves, and the true flow (H, W, 2) [px]."""
    rng = np.random.default_rng(0)
    waves, phases = rng.uniform(-0.5, 0.5, (WAVES, 2)), rng.uniform(0, 2 * np.pi, WAVES)
    depth = np.full((CAMERA.height, CAMERA.width), DEPTH_M)
    h = true_flow(CAMERA, depth, MOVE)
    pixels = CAMERA.pixel_grid().reshape(*depth.shape, 2)

    def painted(where: np.ndarray) -> np.ndarray:
        value = sum(np.sin(where @ wave + phase) for wave, phase in zip(waves, phases, strict=True))
        return np.clip(np.rint(128 + 12 * np.asarray(value)), 0, 255).astype(np.uint8)

    # the whole plane moves alike in the image, by the flow of any pixel
    return painted(pixels), painted(pixels - h[0, 0]), h
