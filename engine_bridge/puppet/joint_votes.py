"""What points inside a character say of the joints of its skeleton."""

from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from engine_bridge.puppet.joint_graph import JointGraph
from solver.anatomy.inside_evidence import Inside
from solver.anatomy.solid import Solid, solid_of
from solver.anatomy.voted_limbs import votes_of
from solver.surface.mesh import SolverMesh

SETS = 2
"""Number of sets of points."""


class JointVotes:
    """Says what points inside a character say of its joints, in any way to see it.

    Parameters
    ----------
    graph : JointGraph
        Some of its joints have vertices.
    surface : SolverMesh
        In the coordinates of the graph.
    """

    def __init__(self, graph: JointGraph, surface: SolverMesh) -> None:
        self._graph, self._surface = graph, surface
        counts = [len(joint.vertices) for joint in graph.joints]
        self._owners = np.repeat(np.arange(len(counts)), counts)

    def __call__(self, axes: NDArray[np.float64]) -> Inside:
        """Return what the points say, for directions (3, 3) of left, up and front."""
        votes = votes_of(self._solid.along(axes), SETS)
        nodes = self._owners[self._followed.query(votes.points @ axes)[1]]
        chances = np.zeros((len(self._graph.joints), votes.chances.shape[1]))
        np.add.at(chances, nodes, votes.chances)
        return Inside(chances, np.bincount(nodes, minlength=len(chances)).astype(float), votes.stands)

    @cached_property
    def _solid(self) -> Solid:
        return solid_of(self._surface)

    @cached_property
    def _followed(self) -> "scipy.spatial.cKDTree":
        return scipy.spatial.cKDTree(np.concatenate([joint.vertices for joint in self._graph.joints]))
