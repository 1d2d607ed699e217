import numpy as np

from flowlik.simulation.render import Mesh, box, quad, tube


def areas(mesh: Mesh) -> np.ndarray:
    a, b, c = (mesh.vertices[mesh.triangles[:, i]].astype(float) for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def uv_areas(mesh: Mesh) -> np.ndarray:
    a, b, c = (mesh.uv[mesh.triangles[:, i]].astype(float) for i in range(3))
    p, q = b - a, c - a
    return np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]) / 2


def test_texture_coordinates_are_in_metres():
    face = quad([(0, 0, 5), (3, 0, 5), (3, 2, 6), (0, 2, 6)], 1)
    np.testing.assert_allclose(uv_areas(face), areas(face), rtol=1e-6)
    block = box([-1, -2, -3], [1, 0, 4], 0)
    np.testing.assert_allclose(uv_areas(block), areas(block), rtol=1e-6)
    np.testing.assert_allclose(areas(block).sum(), 2 * (2 * 2 + 2 * 7 + 2 * 7), rtol=1e-6)


def test_a_box_faces_outwards():
    block = box([-1, -2, -3], [1, 0, 4], 0)
    outwards = block.vertices - np.array([0, -1, 0.5])
    assert ((outwards * block.normals).sum(axis=1) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(block.normals, axis=1), 1, rtol=1e-6)


def test_a_tube_has_its_radius_and_faces_outwards():
    points = np.array([[0, 0, 0], [0.3, -1, 0], [0, -2, 0.5], [0, -3, 0]])
    pipe = tube(points, [0.3, 0.2, 0.2, 0.1], 12, 2)
    axis = np.repeat(points, 13, axis=0)
    np.testing.assert_allclose(
        np.linalg.norm(pipe.vertices - axis, axis=1), np.repeat([0.3, 0.2, 0.2, 0.1], 13), rtol=1e-5
    )
    np.testing.assert_allclose(
        pipe.vertices - axis, pipe.normals * np.repeat([0.3, 0.2, 0.2, 0.1], 13)[:, None], atol=1e-6
    )
    assert (pipe.materials == 2).all()


def test_joined_meshes_keep_their_triangles():
    a, b = box([0, -1, 0], [1, 0, 1], 0), box([5, -1, 0], [6, 0, 2], 3)
    both = Mesh.joined([a, b])
    np.testing.assert_allclose(areas(both), np.concatenate([areas(a), areas(b)]))
    assert list(both.materials) == [0] * 12 + [3] * 12
    assert len(Mesh.joined([]).triangles) == 0
