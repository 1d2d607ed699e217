"""Where a calibrated likelihood is wrong: little texture, an arbitrary eigenbasis, patterns that repeat.

    python examples/when_not_to_trust.py

The page docs/when-not-to-trust.md explains what is printed.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

import flowlik
from flowlik.image import eigenbasis, sample_flow, structure_tensor

CONFIDENCE = 0.9
SHAPE = (160, 200)


def waves(shift: tuple[float, float], contrast: float, noise: float, seed: int = 0) -> np.ndarray:
    """Image (H, W) of random waves, moved by exactly (u, v) [px], with a camera's noise [grey levels]."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]].astype(float)
    wave, phase = rng.uniform(-0.4, 0.4, (40, 2)), rng.uniform(0, 2 * np.pi, 40)
    place = np.stack([u - shift[0], v - shift[1]], axis=-1)
    pattern = np.sin(place @ wave.T + phase).sum(axis=-1) / 6
    dark = np.random.default_rng([seed, *map(abs, np.float64(shift).view(np.int64))])
    image = 128 + contrast * pattern + dark.normal(0, noise, SHAPE)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def coverage(
    model: flowlik.FlowLikelihood, m: flowlik.Measurements, truth: np.ndarray
) -> tuple[float, float]:
    """Share of errors within the model's 90 % interval, and the interval's median half-width [px]."""
    half_width = model.bound(model.coordinate(m), CONFIDENCE)
    return float((np.abs(m.errors(truth)) <= half_width).mean()), float(np.median(half_width))


def low_texture(contrasts: tuple[float, ...] = (40.0, 0.0), moves_px: tuple[float, ...] = (1.0, 4.0, 16.0)):
    """A wall with and without texture moves ever faster: rows of (contrast, move, model, coverage, px)."""
    pixels = np.stack(np.meshgrid(np.arange(30, 170, 4.0), np.arange(30, 130, 4.0)), -1).reshape(-1, 2)
    rows = []
    for contrast in contrasts:
        for move in moves_px:
            pair = waves((0, 0), contrast, 2.0), waves((move, 0), contrast, 2.0)
            for name in ("farneback-lcm", "farneback"):
                model = flowlik.load_likelihood(name)
                m = flowlik.measure(*pair, flowlik.Farneback(), pixels=pixels, signals=model.signals)
                truth = np.tile([move, 0.0], (len(m), 1))
                rows.append((contrast, move, name, *coverage(model, m, truth)))
    return rows


def ambiguous_eigenbasis(noise: float = 2.0) -> list[tuple[float, float, float]]:
    """Rows of (least t2/t1, greatest, median turn [deg] of the eigenbasis when only the noise changes)."""
    (t, R), (_, other) = (eigenbasis(structure_tensor(_noisy(noise, seed))) for seed in (1, 2))
    cosine = np.abs((R[..., :, 0] * other[..., :, 0]).sum(axis=-1)).clip(0, 1)
    turn_deg = np.degrees(np.arccos(cosine))
    ratio = t[..., 1] / np.maximum(t[..., 0], 1e-9)
    edges = (0.0, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
    return [
        (low, high, float(np.median(turn_deg[(ratio >= low) & (ratio < high)])))
        for low, high in pairwise(edges)
    ]


def _noisy(noise: float, seed: int) -> np.ndarray:
    clean = waves((0, 0), 20.0, 0.0).astype(float)
    return np.clip(np.rint(clean + np.random.default_rng(seed).normal(0, noise, SHAPE)), 0, 255).astype(
        np.uint8
    )


def repeated_pattern(period_px: int = 16, moves_px: tuple[float, ...] = (2.0, 6.0, 10.0, 14.0)):
    """A pattern that repeats moves by more than half a period: rows of (move, median error, coverage)."""
    model = flowlik.load_likelihood("lucas-kanade")
    v, u = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]].astype(float)
    pixels = np.stack(np.meshgrid(np.arange(40, 160, 4.0), np.arange(40, 120, 4.0)), -1).reshape(-1, 2)

    def grid(move: float) -> np.ndarray:
        turn = 2 * np.pi / period_px
        image = 128 + 50 * np.sin(turn * (u - move)) + 50 * np.sin(turn * v)
        noise = np.random.default_rng(int(move)).normal(0, 2.0, SHAPE)
        return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)

    rows = []
    for move in moves_px:
        m = flowlik.measure(
            grid(0.0), grid(move), flowlik.LucasKanade(), pixels=pixels, signals=model.signals
        )
        truth = np.tile([move, 0.0], (len(m), 1))
        error_px = float(np.median(np.linalg.norm(m.errors(truth), axis=1)))
        rows.append((move, error_px, coverage(model, m, truth)[0]))
    return rows


def grid_world(speeds_mps: tuple[float, ...] = (6.0, 40.0), worlds: tuple[str, ...] = ("grid", "planes")):
    """A frame's flight over the grid and over planes: rows of (world, speed, median true flow, coverage)."""
    model = flowlik.load_likelihood("lucas-kanade")
    camera = flowlik.Pinhole.from_fov(320, 180, 90.0)
    pixels = np.stack(np.meshgrid(np.arange(10, 310, 5.0), np.arange(10, 170, 5.0)), -1).reshape(-1, 2)
    rows = []
    for world in worlds:
        for speed in speeds_mps:
            flight = flowlik.simulate(world, "straight", 2, speed, 3, camera)
            pair, truth, visible = (flight.image(0), flight.image(1)), flight.flow(0), flight.visible(0)
            m = flowlik.measure(*pair, flowlik.LucasKanade(), pixels=pixels, signals=model.signals)
            column, row = np.rint(m.pixels).astype(int).T
            flow = sample_flow(truth, m.pixels)
            known = np.isfinite(flow).all(axis=1) & visible[row, column]
            flow = flow[known]
            moved_px = float(np.median(np.linalg.norm(flow, axis=1)))
            rows.append((world, speed, moved_px, coverage(model, m.select(known), flow)[0]))
    return rows


def main() -> None:
    """Print the demonstrations."""
    print("Little texture: share of errors within the 90 % interval, and its median half-width")
    for contrast, move, name, share, width in low_texture():
        print(f"  contrast {contrast:3.0f}, {move:4.0f} px a frame, {name:14} {share:5.0%}  {width:6.2f} px")
    print("Arbitrary eigenbasis: how far it turns when only the camera's noise changes")
    for low, high, turn in ambiguous_eigenbasis():
        print(f"  t2/t1 {low:.2f} to {high:.2f}: {turn:5.1f} deg")
    print("A pattern that repeats every 16 px: Lucas-Kanade's median error, and what the 90 % interval holds")
    for move, error, share in repeated_pattern():
        print(f"  moved by {move:4.0f} px: error {error:6.2f} px, {share:5.0%}")
    print("The grid world beside planes: what the 90 % interval holds")
    for world, speed, moved, share in grid_world():
        print(f"  {world:6} at {speed:3.0f} m/s, {moved:.1f} px a frame: {share:5.0%}")


if __name__ == "__main__":
    main()
