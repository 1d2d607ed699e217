"""Saved sketches are read instead of measured, if they are those of the same calibration."""

from dataclasses import replace

import numpy as np
import pytest

from flowlik.calibration import SketchCache, Task, sketch_blocks, split_blocks
from flowlik.calibration.cache import first_sketches
from flowlik.errors import DataError
from flowlik.flow import Farneback
from flowlik.geometry.camera import Pinhole
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.schedule import Index, Input, Term
from flowlik.simulation import simulate
from tests.calibration.test_executors import assert_equal

FLOW = Index((Input("flow", 0.05),), (Term(("flow",)),), 0.0, -3.0, 7.0)
TASKS = (Task(Farneback(), (Index(), FLOW)),)


@pytest.fixture(scope="module")
def sequence():
    camera = Pinhole.from_fov(48, 32, 120.0)
    return simulate("planes", "training", frames=7, speed_mps=12.0, seed=1, camera=camera)


@pytest.fixture(scope="module")
def blocks(sequence):
    return split_blocks(sequence, 3, 2)


@pytest.fixture(scope="module")
def expected(blocks):
    return list(sketch_blocks(blocks, TASKS))


class Counting:
    """A `map` that counts the blocks it is given."""

    def __init__(self):
        self.blocks = []

    def __call__(self, function, *lists):
        for items in zip(*lists):
            self.blocks.append(items[0].firsts[0])
            yield function(*items)


def run(blocks, cache, tasks=TASKS, stop=None):
    """Sketches, and the first frames of the blocks that were measured."""
    counting, found = Counting(), []
    for i, sketches in enumerate(sketch_blocks(blocks, tasks, counting, cache)):
        found.append(sketches)
        if i == stop:
            break
    return found, counting.blocks


def test_what_was_saved_is_not_measured_again(blocks, expected, tmp_path):
    begun = []
    cache = SketchCache(tmp_path / "s", lambda: begun.append((tmp_path / "s").exists()))
    _, measured = run(blocks, cache, stop=1)
    assert measured == [0, 2]
    assert begun[0] is False
    again = SketchCache(tmp_path / "s")
    found, measured = run(blocks, again)
    assert measured == [4]
    assert_equal(found, expected)
    components = sum(sketches[i].total for sketches in expected[:2] for i in first_sketches(TASKS))
    assert again.resumed == {"blocks": 2, "pairs": 4, "components": components}
    assert not again.warnings
    again.remove()
    assert not (tmp_path / "s").exists()


def test_nothing_is_made_before_the_first_block(blocks, tmp_path):
    cache = SketchCache(tmp_path / "s")
    cache.open(blocks, TASKS)
    assert not (tmp_path / "s").exists()
    cache.remove()


def test_a_damaged_file_is_measured_again_with_a_warning(blocks, expected, tmp_path):
    run(blocks, SketchCache(tmp_path))
    path = tmp_path / "block-000001-01.npz"
    path.write_bytes(path.read_bytes()[:-100])
    (tmp_path / "block-000000-00.npz").write_bytes((tmp_path / "block-000000-01.npz").read_bytes())
    cache = SketchCache(tmp_path)
    found, measured = run(blocks, cache)
    assert measured == [0, 2]
    assert_equal(found, expected)
    assert [warning.rpartition("; ")[2] for warning in cache.warnings] == ["measured again"] * 2
    assert "another index" in cache.warnings[0]
    assert cache.warnings[1].startswith(f"{path}: not a flowlik sketch")
    assert run(blocks, SketchCache(tmp_path))[1] == []


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (lambda b, t: ([replace(x, seed=x.seed + 1) for x in b], t), "seeds"),
        (lambda b, t: (b[:2], t), "blocks"),
        (lambda b, t: (b, [replace(t[0], method=Farneback(window=7))]), "method"),
        (lambda b, t: (b, [replace(t[0], texture=TextureDefinition(window=7))]), "texture"),
        (lambda b, t: (b, [replace(t[0], indices=(FLOW, Index()))]), "indices"),
        (lambda b, t: (b, [replace(t[0], keep=("texture-across",))]), "covariates"),
    ],
)
def test_sketches_of_another_calibration_are_refused(blocks, tmp_path, change, key):
    run(blocks, SketchCache(tmp_path), stop=0)
    other, tasks = change(blocks, TASKS)
    with pytest.raises(DataError, match=f"sketches of another calibration .*{key}") as caught:
        run(other, SketchCache(tmp_path), tasks)
    assert "\n" not in str(caught.value)


def test_other_images_of_the_same_name_are_refused(sequence, blocks, tmp_path):
    class Brighter:
        name, camera = sequence.name, sequence.camera

        def __len__(self):
            return len(sequence)

        def image(self, k):
            return np.minimum(sequence.image(k), 254) + np.uint8(1)

    run(blocks, SketchCache(tmp_path), stop=0)
    other = [replace(block, sequence=Brighter()) for block in blocks]
    with pytest.raises(DataError, match="other data"):
        run(other, SketchCache(tmp_path))


def test_a_folder_without_a_plan_is_refused_and_not_emptied(blocks, tmp_path):
    (tmp_path / "thesis.tex").touch()
    cache = SketchCache(tmp_path)
    with pytest.raises(DataError, match="another calibration"):
        run(blocks, cache)
    cache.remove()
    assert (tmp_path / "thesis.tex").exists()
