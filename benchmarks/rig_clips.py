"""Skin weights beside the solver's surface, in recordings to which they were not fitted.

    python -m benchmarks.rig_clips --data FOLDER [--only NAME …]

Characters without a skeleton, or without the one in their file, are rigged as `puppetline new` proposes, and perform
recordings of three sensors. A row is a character: root mean square, 99th percentile and maximum of the distances of its
vertices, in per cent of the diagonal, over all frames; and the 1st and 99th percentile of its edge lengths relative to
rest, with the weights and with the solver.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character import examples
from engine_bridge.character.character import load_character, make_character
from engine_bridge.performance.clip import load_timeline, perform
from engine_bridge.performance.prepared_character import PreparedCharacter, load_prepared, make_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet.proposal import new_puppet
from engine_bridge.rigging import made_rig
from solver.model.batch import BatchBinding
from solver.skinning.weights import Weights, as_matrix, blend_lines

MESHES = (
    "armadillo.obj",
    "homer_6k.obj",
    "dinosaur_14k.obj",
    "cat_7k.obj",
    "gltf/quaternius_Witch.glb",
    "gltf/quaternius_Horse.glb",
)
RECORDINGS = (
    "kinect_own_recording/joints_s02_e01.txt",
    "msrc12/P1_1_1_p19.csv",
    "kinect_v2_laban_csv/Ges02_balancinghands.csv",
)
SETTINGS = Settings(form="rig")
MAX_FRAMES = 150
"""Approximate maximum number of frames of a recording that are compared."""


def main() -> None:
    """Print a row per character."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=[])
    chosen = parser.parse_args()
    print("| character | joints | rms | 99 % | largest | edges p1 / p99 | the solver's |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for name in ("human", *MESHES):
            if not chosen.only or any(part in name for part in chosen.only):
                if name == "human":
                    prepared = load_prepared(examples.prepare(name, Path(folder))[1])
                else:
                    prepared = bare_rig(chosen.data / "mesh" / name)
                print_row(Path(name).stem, prepared, [chosen.data / "logs" / recording for recording in RECORDINGS])


def bare_rig(path: Path) -> PreparedCharacter:
    """Return the puppet that is proposed for a mesh, without the skin of its file."""
    character = load_character(path)
    bare = make_character(path.stem, character.vertices, character.triangles)
    return make_prepared(new_puppet(path, path).puppet, bare)


def print_row(name: str, prepared: PreparedCharacter, recordings: list[Path]) -> None:
    """Print how far the rig of a character is from the solver's surface."""
    made = made_rig.made_rig(prepared)
    away, ours, solvers = [], [], []
    for recording in recordings:
        timeline, notes = load_timeline(recording, SETTINGS)
        clip = perform(prepared, timeline, SETTINGS, notes, lambda _stage, _share: None)
        stride = -(-len(clip.motion) // MAX_FRAMES)
        skinned, surface = places(prepared, made, clip.motion.R[::stride], clip.motion.bones[::stride])
        away.append(np.linalg.norm(skinned - surface, axis=1).ravel() / float(prepared.model.diagonal) * 100)
        ours.append(lengths(prepared, skinned))
        solvers.append(lengths(prepared, surface))
    off = np.concatenate(away)
    edges = " | ".join(
        "{:.2f} / {:.2f}".format(*np.percentile(np.concatenate(each), (1, 99))) for each in (ours, solvers)
    )
    rms, p99 = float(np.sqrt((off**2).mean())), float(np.percentile(off, 99))
    print(f"| {name} | {len(made.skeleton.joints)} | {rms:.2f} | {p99:.2f} | {off.max():.2f} | {edges} |", flush=True)


def places(
    prepared: PreparedCharacter, made: made_rig.MadeRig, controls: NDArray[np.floating], motions: NDArray[np.floating]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the vertices (n, 3, F) by the weights and by the solver, relative to the middle of the character."""
    center, vertices = prepared.model.center, prepared.mesh.vertices
    bones = Weights(made.weights.weights, made.skeleton.bones[made.weights.bones].astype(np.uint16))
    moved = made_rig.with_handles(prepared, controls, motions)
    moved[:, :, 3] += np.einsum("i,fbij->fbj", center, moved[:, :, :3]) - center
    lines = blend_lines(vertices - center, as_matrix(bones, moved.shape[1]))
    skinned = lines @ moved.transpose(2, 1, 3, 0).reshape(lines.shape[1], -1)
    surface = BatchBinding.of_solver_mesh(prepared.model, prepared.mesh).displacements(controls)
    return skinned.reshape(len(vertices), 3, -1), surface.astype(np.float64)


def lengths(prepared: PreparedCharacter, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of edges relative to rest, for vertices (n, 3, F)."""
    a, b = prepared.mesh.edges.T
    rest = np.linalg.norm(prepared.mesh.vertices[a] - prepared.mesh.vertices[b], axis=1)
    known = rest > 0
    return np.asarray((np.linalg.norm(places[a[known]] - places[b[known]], axis=1) / rest[known, None]).ravel())


if __name__ == "__main__":
    main()
