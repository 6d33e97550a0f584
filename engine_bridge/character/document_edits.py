"""Changes that several kinds of animated documents need."""

from collections import Counter

from engine_bridge.character.document import Document
from engine_bridge.character.scene import top_nodes
from engine_bridge.character.schema import Gltf, Mesh, copied


def show_all(gltf: Gltf) -> None:
    """Add a scene with all nodes to a file without scenes, because viewers would show nothing of it."""
    if not gltf["scenes"]:
        gltf["scenes"], gltf["scene"] = [{"nodes": top_nodes(gltf)}], 0


def own_mesh(document: Document, node: int, shown: Counter[int | None]) -> Mesh:
    """Return a mesh that only this node shows, because displacements are in the coordinates of a node.

    Parameters
    ----------
    document : Document
    node : int
    shown : Counter
        Number of nodes that show each mesh; it is updated.
    """
    gltf = document.gltf
    mesh = gltf["nodes"][node]["mesh"]
    if shown[mesh] > 1:
        shown[mesh] -= 1
        gltf["meshes"].append(copied(gltf["meshes"][mesh]))
        gltf["nodes"][node]["mesh"] = mesh = len(gltf["meshes"]) - 1
    return gltf["meshes"][mesh]
