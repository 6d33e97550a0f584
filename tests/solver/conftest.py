"""Small characters, and plain loops that say what the vectorised code must give."""

import tracemalloc

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.model import reduced_model
from solver.surface.mesh import SolverMesh, weld

from .shapes import box, capsules, joined, march, points


@pytest.fixture(scope="session")
def figure():
    """Two arms, two legs and a head on a trunk; the half x ≥ 0 and its mirror image, so symmetric to the last bit."""
    limbs = capsules("""
    0 0   0   0    1.2 0    0.35
    0 1.2 0   0    1.9 0.2  0.22
    0 1.1 0   1.4  1.3 0    0.18
    0 0   0   0.6 -1.5 0.1  0.2
    """)
    v, f = march(limbs, (0.0, -1.9, -0.6), (1.8, 2.3, 0.6), 0.14)
    image = np.where(v[:, :1] == 0, v, v * [-1, 1, 1])
    return weld(*joined((v, f), (image, f[:, ::-1])))


@pytest.fixture(scope="session")
def fine(figure):
    """The figure with 12,226 vertices."""
    return weld(*igl.upsample(figure.vertices, figure.faces, 2))


@pytest.fixture(scope="session")
def figure_model(figure):
    return reduced_model.build(figure)


@pytest.fixture(scope="session")
def creature():
    """A bent, lopsided tube with a horn and a leg: no symmetry, so that no two eigenvalues are equal."""
    limbs = capsules("""
    -1.2 0   0    0    0.2  0    0.3
     0   0.2 0    0.9  0.9  0.2  0.25
    -0.9 0.1 0   -1    0.9 -0.4  0.16
     0   0.1 0    0.2 -1.1  0.3  0.18
    """)
    return weld(*march(limbs, (-1.7, -1.5, -0.8), (1.4, 1.4, 0.8), 0.13))


@pytest.fixture(scope="session")
def creature_model(creature):
    return reduced_model.build(creature)


@pytest.fixture(scope="session")
def creature_handles():
    """Near the two ends of the tube, the horn's tip, the foot and the belly."""
    return points("-1.5 0 0, 1.05 1.05 0.25, -1 1.05 -0.45, 0.2 -1.28 0.33, 0 0 0.3")


@pytest.fixture(scope="session")
def real_mesh(real_data):
    """Load an .obj of the real data by name."""
    return lambda name: weld(*igl.read_triangle_mesh(str(real_data / "mesh" / name)))


@pytest.fixture(scope="session")
def turn():
    """A rotation for row vectors, x' = x · turn(seed, degrees), about a random axis."""

    def make(seed, degrees):
        axis = np.random.default_rng(seed).normal(size=3)
        return Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix().T

    return make


@pytest.fixture(scope="session")
def two_parts(figure):
    """The figure and, a little beside its right hand, a small cube of its own."""
    cube = box("1.7 1.2 -0.1, 2 1.5 0.2")
    vertices, faces = joined((figure.vertices, figure.faces), cube)
    return SolverMesh(vertices, faces, np.arange(len(vertices)))


@pytest.fixture(scope="session")
def naive_interpolation():
    """W of X = W R and W_δ, entry by entry: w_i φ_ik(v) [x y z 1]_c and w_i φ_ik(v) δ_c."""

    def build(rest, isoline_coordinates, weights, isolines, delta):
        m = len(weights) * isolines
        W, W_delta = np.zeros((len(rest), 4 * m)), np.zeros((len(rest), 3 * m))
        for v in range(len(rest)):
            for i, weight in enumerate(weights):
                for k in range(isolines):
                    phi = weight * max(0.0, 1.0 - abs(float(isoline_coordinates[v, i]) - k))
                    column = i * isolines + k
                    W[v, 4 * column : 4 * column + 4] = phi * np.array([*rest[v], 1.0])
                    W_delta[v, 3 * column : 3 * column + 3] = phi * delta[v]
        return W, W_delta

    return build


@pytest.fixture(scope="session")
def surface():
    """All vertices of a mesh in float64 for control variables R in model units: X = W R, in the mesh's coordinates."""

    def of(model, mesh, R):
        return (model.position_matrix(mesh.vertices) @ R) * model.diagonal + model.center

    return of


@pytest.fixture
def allocated():
    """Return the most bytes that a call allocates, once it has been made a few times."""

    def peak(call):
        peaks = []
        tracemalloc.start()
        try:
            for _ in range(100):
                before = tracemalloc.get_traced_memory()[0]
                tracemalloc.reset_peak()
                call()
                peaks.append(tracemalloc.get_traced_memory()[1] - before)
        finally:
            tracemalloc.stop()
        return max(peaks[50:])  # the first few make what Python and Numba keep for every later call

    return peak
