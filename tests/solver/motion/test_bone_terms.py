"""Terms of the surface that bones hold."""

import numpy as np
import pytest

from solver.model.bones import Bones
from solver.model.reduced_model import build
from solver.motion.bone_terms import BLEND_POWER, bone_terms

TWO_BONES = Bones(
    np.array([[0.0, 0.0, 0.0], [0.0, 0.6, 0.0]]),
    np.array([[0.0, 0.6, 0.0], [0.0, 1.2, 0.0]]),
    np.array([-1, 0]),
    np.array([-1, -1]),
)


@pytest.fixture(scope="module")
def shares(figure):
    upper = np.clip(figure.vertices[:, 1] / 1.2, 0.0, 1.0)
    return np.column_stack([1 - upper, upper])


@pytest.fixture(scope="module")
def model(figure, shares):
    return build(figure, None, TWO_BONES, 3 * shares)  # rows are scaled to a sum of 1


def test_vertices_are_held_to_the_blend_of_their_bones(figure, model, shares):
    """The gradient of Σ m ‖W R − Σ_b s_b [x 1] T_b‖² with dense matrices."""
    terms = bone_terms(model, figure, 7.0)
    kept = model.shares.astype(np.float64)
    np.testing.assert_allclose(kept, shares, atol=1e-7)
    kept /= kept.sum(axis=1, keepdims=True)  # stored with single precision
    mass = figure.vertex_areas * (kept / (figure.vertex_areas @ kept)).sum(axis=1)
    mass *= kept.max(axis=1) ** BLEND_POWER
    W = model.position_matrix(figure.vertices).toarray()
    rest = np.column_stack([model.to_model(figure.vertices), np.ones(len(W))])
    normal = W.T @ (mass[:, None] * W)
    pull = np.hstack([W.T @ ((mass * kept[:, bone])[:, None] * rest) for bone in range(2)])
    ratio = np.trace(terms.normal) / np.trace(normal)
    np.testing.assert_allclose(terms.normal, ratio * normal, atol=1e-9 * np.abs(terms.normal).max())
    np.testing.assert_allclose(terms.pull, ratio * pull, atol=1e-9 * np.abs(terms.pull).max())
