"""Joints found from the shape, beside those of the rig that is taken out of the file.

    python -m benchmarks.limb_finding FOLDER

FOLDER holds the rigged characters (kaykit_Knight.glb, quaternius_Adventurer.glb, quaternius_Witch.glb). Each is
measured as its file shows it and, with empty hands, with its arms let down by 35° and 70°. `human` and `biped` are made
by code, which says where their joints are. The table is in percent of body height: one row per character, one column
per joint, and the larger value of left and right.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from puppetline.examples.characters import biped, human

from engine_bridge.character.character import Character, from_document, load_character
from engine_bridge.character.scene import world_transforms
from engine_bridge.puppet.rig_limbs import rig_limbs
from solver.anatomy.limb_finding import find_limbs
from solver.surface.mesh import SolverMesh, weld

RIGGED = ("kaykit_Knight.glb", "quaternius_Adventurer.glb", "quaternius_Witch.glb")
LOWERED = (0, 35, 70)
"""Degrees."""
JOINTS = {"arm": ("shoulder", "elbow", "wrist"), "leg": ("hip", "knee", "ankle")}

Truth = dict[str, NDArray[np.float64]]


def with_lowered_arms(character: Character, degrees: float) -> Character:
    """Turn the upper arms' joints of a character in T-pose down."""
    document = character.document.copy()
    nodes = document.gltf["nodes"]
    world = world_transforms(document)
    for index, node in enumerate(nodes):
        if node.get("name", "").startswith("handslot"):  # what it holds would be stuck into its legs
            for held in node.get("children", []):
                nodes[held].pop("mesh", None)
        for sign, side in ((-1, "l"), (1, "r")):
            if node.get("name", "").lower() == f"upperarm.{side}":
                angle = np.radians(sign * degrees)
                turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
                parent = next(world[i] for i, other in enumerate(nodes) if index in other.get("children", []))
                wanted = world[index].copy()
                wanted[:3, :3] = turn @ wanted[:3, :3]
                for key in ("translation", "rotation", "scale"):
                    node.pop(key, None)
                node["matrix"] = (np.linalg.inv(parent) @ wanted).T.ravel().tolist()
    return from_document(document)


def characters(folder: Path) -> Iterator[tuple[str, SolverMesh, Truth]]:
    """Return each character's name, mesh and joints."""
    for file in RIGGED:
        for degrees in LOWERED:
            character = load_character(folder / file)
            character = with_lowered_arms(character, degrees) if degrees else character
            rig = rig_limbs(character)
            yield f"{Path(file).stem} {degrees}°", character.solver_mesh(), {} if rig is None else rig.points
    made = human.build()
    scale, mirror = human.SCALE, np.array([-1.0, 1.0, 1.0])
    nowhere = np.full(3, np.nan)  # the arm is one tube: nothing says where its elbow is
    arm = scale * np.array([(0.168, 1.372, -0.022), nowhere, (0.468, 0.915, 0.05)])
    leg = scale * np.array([(0.08, 0.90, -0.01), (0.112, 0.50, 0.012), (0.12, 0.105, -0.02)])
    truth = {"left arm": arm, "right arm": arm * mirror, "left leg": leg, "right leg": leg * mirror}
    yield "human", weld(np.asarray(made.vertices, float), np.asarray(made.faces)), truth
    made = biped.build()
    arm = np.array([biped.SHOULDER, biped.ELBOW, biped.WRIST])
    leg = np.array([biped.HIP, biped.KNEE, biped.ANKLE])
    truth = {"left arm": arm, "right arm": arm * mirror, "left leg": leg, "right leg": leg * mirror}
    yield "biped", weld(np.asarray(made.vertices, float), np.asarray(made.faces)), truth


def errors(mesh: SolverMesh, truth: Truth) -> dict[str, list[float]]:
    """Return distances of the joints found from the true ones, left and right, in percent of body height."""
    found = find_limbs(mesh, np.eye(3)).points
    height = float(np.ptp(mesh.vertices[:, 1]))
    result: dict[str, list[float]] = {}
    for limb, names in JOINTS.items():
        for place, name in enumerate(names):
            pairs = [(found.get(f"{side} {limb}"), truth[f"{side} {limb}"]) for side in ("left", "right")]
            result[name] = [
                100.0 if one is None else 100 * float(np.linalg.norm(one[place] - other[place])) / height
                for one, other in pairs
                if np.isfinite(other[place]).all()
            ]
    return result


def main() -> None:
    names = [name for joints in JOINTS.values() for name in joints]
    print("character".ljust(32), *(name.rjust(9) for name in names))
    total: dict[str, list[float]] = {"as made": [], "with lowered arms": []}
    for title, mesh, truth in characters(Path(sys.argv[1])):
        measured = errors(mesh, truth)
        cells = [f"{max(measured[name]):9.1f}" if measured[name] else "        –" for name in names]
        print(title.ljust(32), *cells, flush=True)
        pose = "with lowered arms" if title.endswith(("35°", "70°")) else "as made"
        total[pose] += [each for name in names for each in measured[name]]
    for pose, away in total.items():
        print(f"{pose}, {len(away)} joints: median {np.median(away):.1f} %, 95 % {np.quantile(away, 0.95):.1f} %")


if __name__ == "__main__":
    main()
