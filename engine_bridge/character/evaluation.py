"""Positions of the vertices of an animated document, as viewers show them."""

from collections.abc import Iterator, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from engine_bridge.character.character import Part, rest_weights
from engine_bridge.character.document import Document
from engine_bridge.character.scene import influences, inverse_bind, local_transform, tree
from engine_bridge.character.schema import Node, Sampler


class Evaluation:
    """Evaluates the first animation of a document: its channels, nodes, morph targets and skins.

    Channels of translation, rotation, scale and weights are evaluated; those of extensions are not.

    Parameters
    ----------
    document : Document
    parts : sequence of Part
        Parts of the character from which the document was made, which has the same nodes and primitives.
    """

    def __init__(self, document: Document, parts: Sequence[Part]) -> None:
        self._document = document
        self._tree = tree(document)
        self._surfaces = [_Surface(document, part) for part in parts]

    def positions(self, times: NDArray[np.floating]) -> Iterator[NDArray[np.float64]]:
        """Yield the world positions (N, 3) of the vertices of all parts at times (F,) in seconds."""
        nodes = self._document.gltf["nodes"]
        moved = self._channels(times)
        for frame in range(len(times)):
            shown: dict[int, Node] = {}
            for (node, path), values in moved.items():
                shown.setdefault(node, nodes[node].copy())[path] = values[frame].tolist()  # type: ignore[literal-required]
            world = np.tile(np.eye(4), (len(nodes), 1, 1))
            for node, parent in self._tree:
                local = local_transform(shown.get(node, nodes[node]))
                world[node] = local if parent is None else world[parent] @ local
            yield np.concatenate(
                [each.positions(world, shown.get(each.node, nodes[each.node])) for each in self._surfaces]
            )

    def _channels(self, times: NDArray[np.floating]) -> dict[tuple[int, str], NDArray[np.float64]]:
        """Return the values (F, width) of each animated property by its node and path."""
        found = {}
        for animation in self._document.gltf["animations"][:1]:
            for channel in animation["channels"]:
                target = channel["target"]
                if "node" in target and target["path"] in ("translation", "rotation", "scale", "weights"):
                    sampler = animation["samplers"][channel["sampler"]]
                    found[target["node"], target["path"]] = self._sampled(sampler, times, target["path"] == "rotation")
        return found

    def _sampled(self, sampler: Sampler, times: NDArray[np.floating], turns: bool) -> NDArray[np.float64]:
        """Return the values (F, width) of a sampler (glTF 2.0, appendix C)."""
        keys = self._document.array(sampler["input"]).astype(np.float64)
        values = self._document.array(sampler["output"]).astype(np.float64)
        interpolation = sampler.get("interpolation", "LINEAR")
        at = np.clip(times, keys[0], keys[-1])
        before = np.clip(np.searchsorted(keys, at, side="right") - 1, 0, max(len(keys) - 2, 0))
        after = np.minimum(before + 1, len(keys) - 1)
        step = np.maximum(keys[after] - keys[before], np.finfo(np.float64).tiny)
        share = ((at - keys[before]) / step)[:, None]
        if interpolation == "CUBICSPLINE":
            entering, values, leaving = values.reshape(len(keys), 3, -1).swapaxes(0, 1)
            t2, t3 = share**2, share**3
            return (
                (2 * t3 - 3 * t2 + 1) * values[before]
                + (t3 - 2 * t2 + share) * step[:, None] * leaving[before]
                + (3 * t2 - 2 * t3) * values[after]
                + (t3 - t2) * step[:, None] * entering[after]
            )
        values = values.reshape(len(keys), -1)
        if interpolation == "STEP" or len(keys) == 1:
            return values[np.searchsorted(keys, at, side="right") - 1]
        if turns:
            return Slerp(keys, Rotation.from_quat(values))(at).as_quat()
        return (1 - share) * values[before] + share * values[after]


class _Surface:
    """A part's positions in its own space, with its morph targets and its skin."""

    def __init__(self, document: Document, part: Part) -> None:
        gltf, self.node = document.gltf, part.node
        shown = gltf["nodes"][part.node]
        self._mesh = gltf["meshes"][shown["mesh"]]
        primitive, count = self._mesh["primitives"][part.primitive], len(part.vertices)
        base = document.attribute(primitive, "POSITION", count, 3)
        self._base = np.zeros((count, 3)) if base is None else base.astype(np.float64)
        targets = [
            document.attribute({"attributes": each}, "POSITION", count, 3) for each in primitive.get("targets", [])
        ]
        self._targets = [np.zeros((count, 3), np.float32) if each is None else each for each in targets]
        self._joints: list[int] = []
        if "skin" in shown:
            self._joints = gltf["skins"][shown["skin"]]["joints"]
            self._inverse = inverse_bind(document, shown["skin"])
            which, share = influences(document, primitive, shown["skin"], count)
            rows = np.repeat(np.arange(count), which.shape[1])
            self._shares = scipy.sparse.csr_matrix((share.ravel(), (rows, which.ravel())), (count, len(self._joints)))

    def positions(self, world: NDArray[np.float64], shown: Node) -> NDArray[np.float64]:
        """Return world positions (n, 3) with the world transforms of all nodes and the weights of the part's node."""
        places = self._base
        for weight, target in zip(rest_weights(shown, self._mesh), self._targets, strict=False):
            if weight:
                places = places + weight * target
        if not self._joints:
            to_world = world[self.node]
            return np.asarray(places @ to_world[:3, :3].T + to_world[:3, 3])
        joints = (world[self._joints] @ self._inverse)[:, :3]
        own = np.asarray(self._shares @ joints.reshape(len(joints), 12)).reshape(-1, 3, 4)
        return np.asarray(np.einsum("nij,nj->ni", own[:, :, :3], places) + own[:, :, 3])
