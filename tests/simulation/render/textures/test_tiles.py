import numpy as np
import pytest

from flowlik.errors import DataError
from flowlik.simulation._noise import TILE_PX
from flowlik.simulation.render._textures._natural import NATURAL_TILES
from flowlik.simulation.render._textures.tiles import TILES, make_tiles


@pytest.fixture(scope="module", params=sorted(NATURAL_TILES))
def tile(request: pytest.FixtureRequest) -> np.ndarray:
    return NATURAL_TILES[request.param](np.random.default_rng(3))


def test_natural_tiles_use_the_range_around_a_half(tile: np.ndarray) -> None:
    assert tile.shape == (TILE_PX, TILE_PX) and tile.dtype == np.float32
    assert tile.min() >= 0 and tile.max() <= 1
    assert abs(tile.mean() - 0.5) < 0.01
    assert 0.08 < tile.std() < 0.35


@pytest.mark.parametrize("axis", [0, 1])
def test_natural_tiles_repeat_without_a_seam(tile: np.ndarray, axis: int) -> None:
    steps = np.abs(np.diff(tile, axis=axis)).mean(axis=1 - axis)
    across_border = np.abs(np.take(tile, 0, axis) - np.take(tile, -1, axis)).mean()
    assert across_border < 1.2 * steps.max()


def test_natural_tiles_have_texture_at_every_scale(tile: np.ndarray) -> None:
    power = np.abs(np.fft.fft2(tile - tile.mean())) ** 2
    cycles = np.fft.fftfreq(TILE_PX) * TILE_PX
    radius = np.hypot(cycles[:, None], cycles)
    octaves = 2.0 ** np.arange(2, 9)
    amplitude = [np.sqrt(power[(radius >= low) & (radius < 2 * low)].mean()) for low in octaves]
    slope = np.polyfit(np.log(octaves), np.log(amplitude), 1)[0]
    assert -1.9 < slope < -0.4


def test_a_tile_does_not_depend_on_the_others() -> None:
    alone, among = make_tiles(4, ("earth",)), make_tiles(4, ("macro", "earth", "clouds"))
    np.testing.assert_array_equal(alone.pyramids[0], among.pyramids[1])
    assert among.names == ("macro", "earth", "clouds")


def test_another_seed_draws_another_tile() -> None:
    assert (make_tiles(0, ("macro",)).pyramids != make_tiles(1, ("macro",)).pyramids).mean() > 0.9


def test_levels_are_averages_of_finer_ones() -> None:
    tiles = make_tiles(0, ("litter",))
    levels = np.split(tiles.pyramids[0].astype(float), tiles.level_offsets[1:])
    assert [level.size for level in levels] == [4**k for k in range(10, -1, -1)]
    fine = levels[0].reshape(TILE_PX // 2, 2, TILE_PX // 2, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(levels[1], fine.ravel(), atol=1.01)
    assert abs(levels[-1][0] - levels[0].mean()) < 1


def test_unknown_names_are_refused() -> None:
    with pytest.raises(DataError, match=r"unknown texture 'marble'.*litter"):
        make_tiles(0, ("litter", "marble"))


def test_every_registered_tile_has_the_size_that_kernels_expect() -> None:
    tiles = make_tiles(0, tuple(sorted(TILES)))
    assert tiles.pyramids.shape == (len(TILES), (4**11 - 1) // 3)
    assert (tiles.pyramids.std(axis=1) > 1).all()
