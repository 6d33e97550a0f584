"""Skin weights beside Blender's automatic weights (bone heat) and the artist's own skin.

    python -m benchmarks.rig_weights --data FOLDER [--only NAME …]

The limbs of each rigged character of FOLDER/mesh/gltf are found in its file, and their bones are posed at random. The
artist's weights, added up by bone, move the mesh with these bones. Then the skin is taken away, and the same bones move
the mesh by weights of Blender and of Puppetline, and by the reduced model. Distances from the artist's surface are root
mean squares over vertices and poses, in per cent of the diagonal. Characters whose skeleton lacks a limb are omitted.
Blender's module is that of `make peers`.
"""

import argparse
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import CharacterMesh, load_character, make_character
from engine_bridge.performance.exercise import random_poses
from engine_bridge.performance.prepared_character import PreparedCharacter, make_prepared
from engine_bridge.puppet.proposal import new_puppet
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.puppet.rig_bones import skin_shares
from engine_bridge.rigging import made_rig
from solver.motion.limbs import bones_of, parents_first
from solver.skinning.weights import Weights, as_matrix
from solver.surface.mesh import weld

POSES, SEED = 50, 7

BLENDER = Path(__file__).parent.parent / ".venv-blender" / "bin" / "python"
SCRIPT = Path(__file__).parent / "bone_heat.py"

Floats = NDArray[np.float64]


class Row(NamedTuple):
    """Root mean square distances from the artist's skin in per cent of the diagonal.

    `heat` is Blender's, and `missing` its share of vertices without weights. `ours` is that of the fitted weights,
    `solver` the reduced model's, and `told` the reduced model's that is told the file's own regions. `beside` is the
    distance of our weights from the reduced model.
    """

    name: str
    bones: int
    heat: float
    missing: float
    ours: float
    solver: float
    told: float
    beside: float


def main() -> None:
    """Print a row per character, and the median ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--regions", action="store_true", help="print where the distances are, by bone")
    chosen = parser.parse_args()
    print("| character | bones | bone heat | without weights | ours | / heat | solver | told regions | ours / solver |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    rows = []
    for path in sorted((chosen.data / "mesh" / "gltf").glob("*.glb")):
        if not chosen.only or any(part in path.stem for part in chosen.only):
            rows += list(compared(path, chosen.regions))
    if rows:
        print(f"\nours / bone heat: median {np.median([row.ours / row.heat for row in rows]):.2f}")


def compared(path: Path, by_bone: bool) -> Iterator[Row]:
    """Yield the row of a character, if its file has a skeleton along its limbs."""
    character = load_character(path)
    if not character.document.gltf["skins"]:
        return
    puppet = new_puppet(path, path).puppet
    shares = skin_shares(character, puppet)
    if shares is None:
        return
    bare = make_character(path.stem, character.vertices, character.triangles)
    prepared, told = make_prepared(puppet, bare), make_prepared(puppet, character)
    controls, motions = random_poses(prepared, POSES, SEED)
    own = skinned(shares, character.vertices, motions)
    size, follows = float(prepared.model.diagonal), prepared.mesh.of_render
    heat, missing = bone_heat(bare, puppet)
    made = made_rig.make_rig(prepared)
    ours = Weights(made.weights.weights, made.skeleton.bones[made.weights.bones].astype(np.uint16))
    of_ours = as_matrix(ours, motions.shape[1]).toarray()[follows]
    places = {
        "heat": skinned(heat, character.vertices, motions),
        "ours": skinned(of_ours, character.vertices, motions),
        "solver": surface(prepared, controls)[:, follows],
        "told": surface(told, random_poses(told, POSES, SEED)[0])[:, told.mesh.of_render],
    }
    off = {name: np.linalg.norm(place - own, axis=2) / size * 100 for name, place in places.items()}
    rms = {name: float(np.sqrt((each**2).mean())) for name, each in off.items()}
    beside = np.linalg.norm(places["ours"] - places["solver"], axis=2) / size * 100
    row = Row(path.stem, motions.shape[1], missing=missing, beside=float(np.sqrt((beside**2).mean())), **rms)
    print(
        f"| {row.name} | {row.bones} | {row.heat:.2f} | {missing:.0%} | {row.ours:.2f} | {row.ours / row.heat:.2f} | "
        f"{row.solver:.2f} | {row.told:.2f} | {row.beside:.2f} |",
        flush=True,
    )
    if by_bone:
        print_regions(puppet, told, off)
    yield row


def print_regions(puppet: Puppet, told: PreparedCharacter, off: dict[str, Floats]) -> None:
    """Print the distances of the vertices that the file's skin gives to each bone."""
    owner = told.model.regions.owner[told.mesh.of_render]
    names = [(limb.name, number) for limb in parents_first(puppet.limbs) for number in range(len(limb.points) - 1)]
    for bone, (limb, number) in enumerate(names):
        own = owner == bone
        if own.any():
            means = "  ".join(f"{name} {np.sqrt((each[:, own] ** 2).mean()):5.2f}" for name, each in off.items())
            print(f"    {limb:16} {number}  {own.mean():6.1%}  {means}")


def skinned(weights: Floats, rest: Floats, motions: Floats) -> Floats:
    """Return linear blend skinning (F, N, 3) with weights (N, b); without weights a vertex stays at rest."""
    out = np.array([blend(weights, rest, motion) for motion in motions])
    still = 1 - weights.sum(axis=1, keepdims=True)
    return out + still * rest


def blend(weights: Floats, rest: Floats, motion: Floats) -> Floats:
    """Return Σ_b w_b [x 1] T_b for one pose (b, 4, 3)."""
    blended = (weights @ motion.reshape(len(motion), 12)).reshape(-1, 4, 3)
    return np.einsum("ni,nij->nj", rest, blended[:, :3]) + blended[:, 3]


def surface(prepared: PreparedCharacter, controls: NDArray[np.float32]) -> Floats:
    """Return the positions (F, n, 3) of the reduced model."""
    W = prepared.model.position_matrix(prepared.mesh.vertices)
    return np.array(
        [(W @ R) * float(prepared.model.diagonal) + prepared.model.center for R in controls.astype(np.float64)]
    )


def bone_heat(character: CharacterMesh, puppet: Puppet) -> tuple[Floats, float]:
    """Return Blender's weights (N, b), whose rows sum to 1 or 0, and the share of vertices without weights."""
    mesh, bones = weld(character.vertices, character.triangles, "mesh"), bones_of(puppet.limbs)
    with tempfile.TemporaryDirectory() as folder:
        source, output = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(
            source,
            vertices=mesh.vertices,
            triangles=mesh.faces,
            heads=bones.heads,
            tails=bones.tails,
            parents=bones.parents,
        )
        subprocess.run([BLENDER, SCRIPT, source, output], check=True, capture_output=True)
        weights = np.load(output)["weights"]
    total = weights.sum(axis=1, keepdims=True)
    shares = np.divide(weights, total, out=np.zeros_like(weights), where=total > 0)
    return shares[mesh.of_render], float((total == 0).mean())


if __name__ == "__main__":
    main()
