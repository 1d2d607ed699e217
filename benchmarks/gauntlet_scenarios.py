"""The situations of the gauntlet: each makes a clip from a seed and the number of motions to judge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.simulation import Sensor
from flowlik.support.arrays import Array
from gauntlet_clips import CAMERA, Clip, Grey, at_events, drive, forest, grey, hall, staged, with_images
from gauntlet_scene import Rectangle, Scene, gallery, looking, natural_textures, plane, squares

Make = Callable[[int, int, Path], Clip]
BOTH = ("depth", "epipolar")
DEPTH = ("depth",)


@dataclass(frozen=True)
class Scenario:
    """One row of the gauntlet.

    Attributes
    ----------
    name : str
        Of the dataset in records.
    shows : str
        What happens, in a few words.
    make : callable
        Clip from seed, motions to judge, and cache folder.
    residuals : tuple of str
        Where it differs from an ordinary clip.
    goal : bool
        Whether the goal of 1 % grossly wrong is meant for it.
    """

    name: str
    shows: str
    make: Make
    residuals: tuple[str, ...] = BOTH
    goal: bool = True


def room(seed: int, half_m: tuple[float, float, float] = (5.0, 3.0, 6.0)) -> Scene:
    """A closed box about the origin."""
    sides = [
        plane(
            sign * np.eye(3)[axis], half_m[axis], 0.8 * half_m[axis] / CAMERA.fx, (2 * axis + (sign > 0)) % 4
        )
        for axis in range(3)
        for sign in (-1, 1)
    ]
    return Scene(sides, natural_textures(seed))


def turning(seed: int, pairs: int, name: str, axis: str, degrees: float) -> Clip:
    """Nothing but a rotation by the same angle a frame."""
    angles = degrees * np.arange(pairs + 1) + 40.0 * (seed % 9)
    poses = RigidTransform.from_rotation(Rotation.from_euler(axis, angles[:, None], degrees=True))
    return staged(name, seed, room(seed), poses)


def pan(degrees: float) -> Scenario:
    name = f"pan-{degrees:g}"
    return Scenario(
        name, f"pan of {degrees:g}° a frame",
        lambda seed, pairs, cache: turning(seed, pairs, name, "Y", degrees),
    )  # fmt: skip


def standstill(seed: int, pairs: int, cache: Path) -> Clip:
    poses = RigidTransform.from_rotation(Rotation.from_euler("Y", np.full((pairs + 1, 1), 0.7 * seed)))
    return staged("standstill", seed, room(seed), poses)


def drifting(rng: np.random.Generator, pairs: int, step_m: Array, turn_deg: float) -> RigidTransform:
    """Poses of a camera that goes on by a step (3,) in {n}, bobs, and turns by up to some angle a frame."""
    k = np.arange(pairs + 1)[:, None]
    waves = np.sin(2 * np.pi * k / rng.uniform(15, 40, 3) + rng.uniform(0, 7, 3))
    bobs = 0.3 * np.linalg.norm(step_m) * waves
    angles = turn_deg * 4 * np.sin(2 * np.pi * k / rng.uniform(25, 60, 3) + rng.uniform(0, 7, 3))
    attitude = Rotation.from_euler("YXZ", angles, degrees=True)
    return RigidTransform.from_components(k * step_m + bobs, attitude)


def oblique_wall(seed: int, pairs: int, cache: Path) -> Clip:
    rng = np.random.default_rng([seed, 2])
    side = rng.choice([-1, 1])
    normal = np.array([side * np.sin(a := np.deg2rad(rng.uniform(20, 45))), 0, np.cos(a)])
    along = np.array([side * np.cos(a), 0, -np.sin(a)])
    step = 0.08 * along + 0.02 * normal + np.array([0, rng.uniform(-0.02, 0.02), 0])
    poses = drifting(rng, pairs, step, rng.choice([0.0, 0.2]))
    return staged("plane-oblique", seed, Scene([plane(normal, 6.0, 0.013)], natural_textures(seed)), poses)


def blank(name: str, level: int) -> Make:
    """One or two frames in five show nothing but a level of grey, with a little noise unless it clips."""

    def make(seed: int, pairs: int, cache: Path) -> Clip:
        frames = 2 * pairs + 6
        clip = hall(seed, frames, cache)
        k = np.arange(frames)
        gone = (k % 5 == 3) | (k % 10 == 4)

        def image(k: int) -> np.ndarray:
            if not gone[k]:
                return clip.image(k)
            noise = np.random.default_rng([seed, k]).normal(0, 1, clip.image(k).shape)
            return np.clip(np.rint(level + noise * (0 < level < 255)), 0, 255).astype(np.uint8)

        return replace(with_images(clip, name, image), judged=at_events(frames, gone))

    return make


def cut(seed: int, pairs: int, cache: Path) -> Clip:
    """Every four frames the camera, on the same way, is in another hall: the pair shows no motion."""
    frames = 2 * pairs + 8
    here, there = hall(seed, frames, cache), hall(seed, frames, cache, other=True)
    k = np.arange(frames)
    inside = (k // 4) % 2 == 1

    def of(k: int) -> Clip:
        return there if inside[k] else here

    clip = with_images(here, "cut", lambda k: of(k).image(k))
    events = np.append(False, np.diff(inside))
    return replace(clip, depth=lambda k: of(k).depth(k), judged=at_events(frames, events))


def roll(seed: int, pairs: int, cache: Path) -> Clip:
    return turning(seed, pairs, "roll", "Z", (0.2, 0.5, 1.0, 2.0, 3.0)[seed % 5])


def turn_in_drive(seed: int, pairs: int, cache: Path) -> Clip:
    """A robot drives eight frames, turns on the spot for eight, to and fro by turns, and drives on."""
    frames = 8 + 8 * pairs // 5
    rng = np.random.default_rng([seed, 3])
    k = np.arange(frames)
    turns, sense = k % 16 >= 8, np.where((k // 16) % 2, -1, 1)
    yaw = np.cumsum(np.where(turns, sense * rng.uniform(0.5, 3.0), 0.0))
    ahead = Rotation.from_euler("Y", yaw[:, None], degrees=True)
    step = ahead.apply(np.array([0, 0, 0.06])) * ~turns[:, None]
    # there and back again, so that the room is never left
    position = np.cumsum(step * np.where((k // 32) % 2, -1, 1)[:, None], axis=0)
    poses = RigidTransform.from_components(position, ahead)
    clip = staged("turn-in-drive", seed, room(seed, (3.0, 2.0, 6.0)), poses)
    # the motion into frame k is a turn where its yaw has changed
    return replace(clip, judged=at_events(frames, turns, 2))


def blinking(seed: int, pairs: int, cache: Path) -> Clip:
    """Nothing moves but a light that goes on and off, over a tenth of the image."""
    still = standstill(seed, pairs, cache)
    top, left = np.random.default_rng([seed, 4]).integers(20, 100, 2)

    def image(k: int) -> Grey:
        seen = still.image(k).astype(np.float64)
        seen[top : top + 70, left : left + 130] *= 1.5 if (k // 3) % 2 else 0.8
        return grey(seen)

    return with_images(still, "standstill-blink", image)


def one_plane(
    name: str, normal: tuple[float, float, float], distance_m: float, step_m: tuple[float, float, float]
) -> Make:
    """One plane n . X = d in the first camera's frame, and a camera that goes by about one step a frame."""

    def make(seed: int, pairs: int, cache: Path) -> Clip:
        rng = np.random.default_rng([seed, 5])
        step = np.array(step_m) * rng.uniform(0.6, 1.3) * rng.choice([-1, 1])
        scene = Scene(
            [plane(np.array(normal), distance_m, 0.8 * distance_m / CAMERA.fx)], natural_textures(seed)
        )
        return staged(name, seed, scene, drifting(rng, pairs, step, rng.choice([0.0, 0.2])))

    return make


def two_planes(seed: int, pairs: int, cache: Path) -> Clip:
    """A wall on a floor, or two walls that meet, and a camera that goes along them."""
    rng = np.random.default_rng([seed, 6])
    if seed % 2:
        planes = [plane(np.array([0, 0, 1.0]), 8.0, 0.018), plane(np.array([0, 1.0, 0]), 1.5, 0.006, 1)]
    else:
        planes = [plane(np.array([s, 0, 1.0]), 5.0, 0.012, s + 1) for s in (-1, 1)]
    step = np.array([0.05, rng.uniform(-0.01, 0.01), 0.02])
    return staged("two-planes", seed, Scene(planes, natural_textures(seed)), drifting(rng, pairs, step, 0.1))


def epipole(seed: int, pairs: int, cache: Path) -> Clip:
    """Straight ahead through a corridor with boards: the epipole is within the image."""
    rng = np.random.default_rng([seed, 7])
    return staged("epipole", seed, corridor(rng), drifting(rng, pairs, np.array([0, 0, 0.08]), 0.1))


def corridor(rng: np.random.Generator, length_m: float = 25.0) -> Scene:
    """A corridor along z with boards along its walls."""
    walls = [
        plane(np.array(n), d, 0.01, t)
        for n, d, t in (
            ((1.0, 0, 0), 2.0, 0), ((-1.0, 0, 0), 2.0, 1), ((0, 1.0, 0), 1.4, 2), ((0, -1.0, 0), 1.6, 3),
            ((0, 0, 1.0), length_m, 0),
        )
    ]  # fmt: skip
    boards = []
    for z in np.arange(3.0, length_m - 1, 0.9):
        right, down = looking(np.array([*rng.normal(0, 0.3, 2), 1.0]))
        centre = np.array([rng.choice([-1, 1]) * rng.uniform(1.1, 1.9), rng.uniform(-1.4, 1.2), z])
        boards.append(Rectangle(centre, right, down, (0.35, 0.35), 0.008, int(rng.integers(4))))
    return Scene([*walls, *boards], natural_textures(int(rng.integers(1000))))


def tiny_parallax(seed: int, pairs: int, cache: Path) -> Clip:
    """A pan over a gallery of boards with a millimetre or two of translation: a tenth of a pixel or less."""
    rng = np.random.default_rng([seed, 8])
    k = np.arange(pairs + 1)[:, None]
    direction = rng.normal(size=3) * [1, 1, 0.5]
    step = rng.uniform(0.0005, 0.002) * direction / np.linalg.norm(direction)
    yaw = 4 * np.sin(k * 0.1 * rng.uniform(0.5, 1.5))
    poses = RigidTransform.from_components(k * step, Rotation.from_euler("Y", yaw, degrees=True))
    return staged("tiny-parallax", seed, gallery(rng, CAMERA), poses)


def wandering(
    rng: np.random.Generator, step_m: float = 0.05, periods: tuple[float, float] = (16, 40)
) -> Callable[[Array], RigidTransform]:
    """Poses at times (N,) [frames] about one place: to and fro, up and down, with as much turning."""
    period, phase = rng.uniform(*periods, 6), rng.uniform(0, 7, 6)

    def poses(times: Array) -> RigidTransform:
        waves = period / (2 * np.pi) * np.sin(2 * np.pi * times[:, None] / period + phase)
        attitude = Rotation.from_euler("YXZ", 0.2 * waves[:, :3], degrees=True)
        return RigidTransform.from_components(step_m * waves[:, 3:] * [1, 0.5, 1], attitude)

    return poses


def frozen(seed: int, pairs: int, cache: Path) -> Clip:
    """Every third frame is the one before once more, bit for bit, while the camera goes on."""
    frames = 3 * pairs + 1
    clip = hall(seed, frames, cache)
    gone = np.arange(frames) % 3 == 2
    images = with_images(clip, "frozen", lambda k: clip.image(k - 1 if gone[k] else k))
    return replace(images, judged=gone)


def dropped(seed: int, pairs: int, cache: Path) -> Clip:
    """Two to five frames are lost every four."""
    rng = np.random.default_rng([seed, 9])
    count = 2 * pairs + 4
    jumps = np.where(np.arange(count) % 4 == 3, rng.integers(3, 7, count), 1)
    kept = np.cumsum(jumps) - 1
    clip = hall(seed, int(kept[-1]) + 1, cache)
    shown = replace(
        with_images(clip, "dropped", lambda k: clip.image(int(kept[k]))),
        poses=clip.poses[kept], depth=lambda k: clip.depth(int(kept[k])),
    )  # fmt: skip
    return replace(shown, judged=at_events(count, jumps > 1))


def exposure(seed: int, pairs: int, cache: Path) -> Clip:
    """Exposure doubles or halves every other frame."""
    frames = 2 * pairs + 1
    clip = hall(seed, frames, cache)
    stops = np.array([0, 1, 0, -1])[(np.arange(frames) // 2) % 4]
    light = with_images(clip, "exposure", lambda k: exposed(clip.image(k), 2.0 ** stops[k]))
    return replace(light, judged=np.append(False, np.diff(stops) != 0))


def exposed(image: Grey, gain: float) -> Grey:
    """Image (H, W) had it got so much more light."""
    return grey(255 * np.minimum(gain * light_of(image), 1) ** (1 / 2.2))


def covered(seed: int, pairs: int, cache: Path) -> Clip:
    """Half of the image, left, right or below, is covered: by something plain, or that rides along."""
    clip = hall(seed, pairs + 1, cache)
    v, u = np.mgrid[: clip.camera.height, : clip.camera.width]
    side = (u < clip.camera.width / 2, u >= clip.camera.width / 2, v >= clip.camera.height / 2)[seed % 3]
    cover = 90.0 + (seed % 2) * 30 * natural_textures(seed)[0, 1][: len(v), : len(u[0])]

    def image(k: int) -> Grey:
        noise = np.random.default_rng([seed, k]).normal(0, 1.5, v.shape)
        return np.where(side, grey(cover + noise), clip.image(k))

    return with_images(clip, "half-covered", image)


def vehicle(seed: int, pairs: int, cache: Path) -> Clip:
    """A vehicle fills 60 % of the image and goes its own way; the first six frames are without it."""
    rng = np.random.default_rng([seed, 10])
    frames = pairs + 7
    poses, still = wandering(rng)(np.arange(frames)), gallery(rng, CAMERA, 3.0)
    own = 0.04 * rng.uniform(0.5, 1.5) * rng.choice([-1, 1])
    width, height = 2.5 * CAMERA.width / CAMERA.fx / 2, 2.5 * CAMERA.height / CAMERA.fy / 2

    def scene(k: int) -> Scene:
        if k < 6:
            return still
        # it keeps before the camera but for a slow way of its own
        sway = own * np.array([10 * np.sin(k / 10), 3 * np.sin(k / 7), 4 * np.cos(k / 9)])
        centre = poses[k].apply(np.array([0, 0, 2.5])) + sway
        right, down = looking(np.array([0.2, 0, 1.0]))
        side = Rectangle(centre, right, down, (0.8 * width, 0.75 * height), 0.007, 3)
        return replace(still, rectangles=[*still.rectangles, side])

    # judged from where both frames show it
    return replace(staged("vehicle", seed, scene, poses), judged=np.arange(frames) > 6)


def rail(seed: int, pairs: int, cache: Path) -> Clip:
    """A band along the road, 30 % of the image, whose pattern slides along with the camera."""
    rng = np.random.default_rng([seed, 11])
    poses = drifting(rng, pairs, np.array([0.06, 0, 0.01]), 0.1)
    still, share = gallery_row(rng), rng.uniform(0.3, 0.8)
    half = 0.3 * 2.0 * CAMERA.height / CAMERA.fy / 2

    def scene(k: int) -> Scene:
        x = share * poses[k].translation[0]
        band = Rectangle(np.array([x, 0.15, 2.0]), *looking(np.array([0, 0, 1.0])), (60.0, half), 0.006, 2)
        return replace(still, rectangles=[*still.rectangles, band])

    return staged("rail", seed, scene, poses)


def gallery_row(rng: np.random.Generator) -> Scene:
    """A long wall with boards at all depths before it, for a camera that passes."""
    rectangles = [plane(np.array([0, 0, 1.0]), 9.0, 0.02)]
    for x in np.arange(-8.0, 14.0, 0.5):
        z = rng.uniform(2.5, 8.0)
        right, down = looking(np.array([*rng.normal(0, 0.3, 2), 1.0]))
        centre = np.array([x, rng.uniform(-0.4, 0.4) * z, z])
        size = (0.12 * z, 0.12 * z)
        rectangles.append(Rectangle(centre, right, down, size, z / CAMERA.fx, int(rng.integers(4))))
    return Scene(rectangles, natural_textures(int(rng.integers(1000))))


def pattern(seed: int, pairs: int, cache: Path) -> Clip:
    """Half of the image is a pattern that moves by 0.6 to 0.9 of its period a frame."""
    rng = np.random.default_rng([seed, 12])
    still = gallery_row(rng)
    texel, period = 0.008, 16
    textures = np.concatenate([still.textures, squares(period)])
    step = rng.uniform(0.6, 0.9) * period * texel
    poses = drifting(rng, pairs, np.array([step, 0, 0.01]), 0.05)
    half = 0.5 * 3.0 * CAMERA.height / CAMERA.fy / 2
    fence = Rectangle(np.array([0, 0.1, 3.0]), *looking(np.array([0, 0, 1.0])), (60.0, half), texel, 4, 50.0)
    return staged("pattern", seed, Scene([*still.rectangles, fence], textures), poses)


def low_light(seed: int, pairs: int, cache: Path) -> Clip:
    """So little light that photons and the sensor's noise are seen."""
    clip = hall(seed, pairs + 1, cache)
    dark = Sensor(exposure_s=0, psf_sigma_px=0, vignetting=0, gain=0.02, gain_sd=0, gamma_sd=0)

    def image(k: int) -> Grey:
        return dark.expose(light_of(clip.image(k)), clip.camera, seed, k)

    return with_images(clip, "low-light", image)


def light_of(image: Grey) -> np.ndarray:
    """Linear light (H, W) of grey levels, by the sensor's usual response."""
    return np.asarray((image / 255.0) ** 2.2, np.float32)


def filtered(name: str, through: Callable[[Grey], Grey]) -> Make:
    """A flight through the hall, each image through a filter."""

    def make(seed: int, pairs: int, cache: Path) -> Clip:
        clip = hall(seed, pairs + 1, cache)
        return with_images(clip, name, lambda k: through(clip.image(k)))

    return make


def defocused(image: Grey) -> Grey:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 3.0), np.uint8)


def compressed(image: Grey) -> Grey:
    coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 10])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), np.uint8)


def bordered(image: Grey) -> Grey:
    """Black where an undistorted image has nothing to show: beyond arcs at its four sides."""
    height, width = image.shape
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    return np.where((np.abs(x) < 0.98 - 0.12 * y**2) & (np.abs(y) < 0.97 - 0.15 * x**2), image, 0)


def depth_told(name: str, told: Callable[[Array, np.random.Generator], Array]) -> Make:
    """A clean flight through the hall whose depth is told wrongly."""

    def make(seed: int, pairs: int, cache: Path) -> Clip:
        clip = hall(seed, pairs + 1, cache)
        return replace(clip, name=name, depth=lambda k: told(clip.depth(k), np.random.default_rng([seed, k])))

    return make


def with_noise(depth: Array, rng: np.random.Generator) -> Array:
    return np.asarray(depth * (1 + 0.02 * rng.standard_normal(depth.shape)))


def with_holes(depth: Array, rng: np.random.Generator) -> Array:
    """Depth unknown in blobs, some two fifths of the image."""
    blobs = cv2.GaussianBlur(rng.standard_normal(depth.shape), (0, 0), 8.0)
    return np.where(blobs > np.quantile(blobs, 0.6), np.nan, depth)


def misregistered(depth: Array, rng: np.random.Generator) -> Array:
    """Depth of the pixel two to the right."""
    return np.asarray(np.concatenate([depth[:, 2:], depth[:, -1:], depth[:, -1:]], axis=1))


def focal_wrong(seed: int, pairs: int, cache: Path) -> Clip:
    """The focal length told is 1 % too long."""
    clip = hall(seed, pairs + 1, cache)
    c = clip.camera
    return replace(clip, name="focal", camera=replace(c, fx=1.01 * c.fx, fy=1.01 * c.fy))


def rolling(seed: int, pairs: int, cache: Path) -> Clip:
    """A shaken camera whose rows are read over 10 of 33 ms; the truth is the middle row's."""
    rng = np.random.default_rng([seed, 13])
    poses = wandering(rng, periods=(4, 12))
    rows = 0.3 * (np.arange(CAMERA.height) - CAMERA.height // 2) / (CAMERA.height - 1)
    scene = gallery(rng, CAMERA)
    return staged("rolling-shutter", seed, scene, poses(np.arange(pairs + 1)), lambda k: poses(k + rows))


def figure_eight(seed: int, frames: int, cache: Path) -> Clip:
    return forest(seed, frames, cache, "forest-fig8")


def clean(name: str, flight: Callable[[int, int, Path], Clip]) -> Make:
    return lambda seed, pairs, cache: replace(flight(seed, pairs + 1, cache), name=name)


_ALL = (
    pan(0.1), pan(0.3), pan(1.0), pan(3.0),
    Scenario("roll", "roll of 0.2 to 3° a frame", roll),
    Scenario("turn-in-drive", "turns on the spot within a drive", turn_in_drive),
    Scenario("standstill", "nothing moves, noise alone", standstill),
    Scenario("standstill-blink", "nothing moves, a light blinks", blinking),
    Scenario("plane-fronto", "one wall, seen square on",
             one_plane("plane-fronto", (0, 0, 1), 5.0, (0.07, 0.02, 0))),
    Scenario("plane-oblique", "one wall, seen from the side", oblique_wall),
    Scenario("plane-ground", "ground, seen at 45°",
             one_plane("plane-ground", (0, 1, 1), 3.0, (0, -0.04, 0.04))),
    Scenario("plane-nadir", "ground straight below",
             one_plane("plane-nadir", (0, 0, 1), 6.0, (0.02, 0.09, 0))),
    Scenario("two-planes", "two planes", two_planes),
    Scenario("epipole", "epipole within the image", epipole),
    Scenario("tiny-parallax", "a pan with a tenth of a pixel of parallax", tiny_parallax),
    Scenario("black", "a black frame or two", blank("black", 0)),
    Scenario("white", "a white frame or two", blank("white", 255)),
    Scenario("grey", "a grey frame or two, with noise", blank("grey", 128)),
    Scenario("frozen", "a frame comes twice while the camera moves", frozen),
    Scenario("cut", "the scene is cut", cut),
    Scenario("dropped", "2 to 5 frames are lost", dropped),
    Scenario("exposure", "exposure doubles or halves", exposure),
    Scenario("half-covered", "half of the image is covered", covered),
    Scenario("vehicle", "a vehicle fills 60 % of the image", vehicle),
    Scenario("rail", "30 % of the image slides along a rail", rail),
    Scenario("pattern", "half is a pattern, moved beyond half its period", pattern),
    Scenario("low-light", "hardly any light", low_light),
    Scenario("defocus", "out of focus", filtered("defocus", defocused)),
    Scenario("jpeg", "JPEG of quality 10", filtered("jpeg", compressed)),
    Scenario("border", "black border after undistortion", filtered("border", bordered)),
    Scenario("depth-noise", "2 % noise of depth", depth_told("depth-noise", with_noise), DEPTH),
    Scenario("depth-holes", "two fifths without depth", depth_told("depth-holes", with_holes), DEPTH),
    Scenario("depth-shift", "depth is 2 px beside", depth_told("depth-shift", misregistered), DEPTH),
    Scenario("focal", "focal length 1 % too long", focal_wrong),
    Scenario("rolling-shutter", "rows read over 10 ms, shaken", rolling, goal=False),
    Scenario("hall", "clean: hall of planes", clean("hall", hall)),
    Scenario("forest", "clean: forest", clean("forest", forest)),
    Scenario("fig8", "clean: forest, figure eight", clean("fig8", figure_eight)),
    Scenario("drive", "clean: drive with traffic", clean("drive", drive)),
)  # fmt: skip
SCENARIOS = {s.name: s for s in _ALL}
"""By name, in the order of the table."""
