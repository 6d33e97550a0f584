"""How closely characters follow performers, compared with the file's own rig and the raw recording.

python -m benchmarks.fidelity --data FOLDER [--sheets FOLDER] [--characters …] [--recordings …] [--limbs none rig shape]
    [--directions-only]

prints the table of docs/limbs.md: for each rigged humanoid and recording, with handles only, with limbs from the rig,
and with limbs from the shape. The rig always determines which vertices are measured. If the limbs are from the rig, its
linear blend skinning by the same motions is the reference.

With --directions-only, hands do not meet and feet are not locked to the floor: what remains is how well limbs follow.

- Directions: the rotation that fits the vertices of a bone best (those that the rig gives to it alone, or most if it
  gives none) turns the bone's rest direction; its angle to the direction from joint to joint in the recording, which
  may be rotated as a whole by at most 12°.
- Noise of the log: angles of the recording's own limbs to those of the median of three frames.
- Hands together: share of the frames in which the performer's hands are near each other. The character's hands are
  then drawn together, so its arms point elsewhere.
- Edges: lengths relative to the rest pose, 1st and 99th percentile, for the character and for skinning.
- Distance: of vertices from their positions by skinning, in % of the diagonal.
- Feet: distance of the character's sole from its mean position while a foot of the performer stands, and its height
  above or below the floor; 95th percentiles in % of the height.
"""

import argparse
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from capture import body
from capture.skeleton import JOINT_INDEX, to_character_axes
from capture.timeline import Timeline
from engine_bridge.character.character import CharacterMesh, load_character, make_character
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.clip import load_timeline, perform, resting_pose
from engine_bridge.performance.prepared_character import PreparedCharacter, load_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.pictures import clip_sheet
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.proposal import new_puppet
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.puppet.rig_bones import rig_bones
from engine_bridge.puppet.rig_limbs import rig_limbs
from engine_bridge.puppet.skin_joints import vertex_influences
from solver.model.batch import BatchBinding
from solver.motion.arms import APART_ARM_LENGTHS
from solver.motion.limbs import TRUNK, Limb, bones_of, parents_first

CHARACTERS = ("kaykit_Knight", "quaternius_Adventurer", "quaternius_Witch", "quaternius_George")
RECORDINGS = (
    "utkinect/joints_s01_e01.txt",
    "kinect_own_recording/joints_s02_e01.txt",
    "msrc12/P1_1_1_p19.csv",
    "msr_action3d_world/a18_s01_e01_skeleton3D.txt",
    "utd_mhad_mat/a22_s1_t1_skeleton.mat",
    "kinect_v2_laban_csv/Ges02_balancinghands.csv",
)
LIMB_SOURCES = ("none", "rig", "shape")
"""Sources of a character's limbs: no limbs but handles, the file's rig, the shape."""
SETTINGS = Settings()
MEASURED_FRAMES = 120
"""Number of frames of each recording that are measured."""
MAX_TILT_DEGREES = 12.0
"""Largest rotation of a whole recording."""
SHOWN = {
    "upper arms": ("arm", 0),
    "forearms": ("arm", 1),
    "thighs": ("leg", 0),
    "shins": ("leg", 1),
    "trunk": (TRUNK, 1),
}
"""Kinds of bones that are measured: the end of the limb's name, and the number of the bone."""
JOINTS = {"arm": ("shoulder", "elbow", "wrist", "hand"), "leg": ("hip", "knee", "ankle", "foot")}
MAX_STANDING_SPEED = 0.15
"""Largest speed of a standing foot, in metres per second."""
MAX_STANDING_HEIGHT = 0.05
"""Largest height of a standing foot above its lowest position, in metres."""
MIN_STANDING_FRAMES = 10
"""Smallest number of frames that a foot stands."""
SINGLE_BONE_WEIGHT = 0.95
"""Weight above which a vertex counts as moved by one bone alone."""


@dataclass(frozen=True)
class Truth:
    """What the file's own rig determines about a character.

    Attributes
    ----------
    bones : dict
        (limb, number of the bone) to its rest direction, and the vertices that follow this bone alone.
    which, share : (N, k)
        Rig joints that each vertex follows, and their weights.
    owner : (joints,) tuple of (limb, number)
        The bone to which each rig joint belongs.
    soles : dict
        Side to the lowest vertices of its foot.
    """

    bones: dict[tuple[str, int], tuple[NDArray[np.float64], NDArray[np.int64]]]
    which: NDArray[np.int64]
    share: NDArray[np.float64]
    owner: tuple[tuple[str, int], ...]
    soles: dict[str, NDArray[np.int64]]


def read_rig(character: CharacterMesh) -> Truth:
    """Assign a skeleton's joints, and the vertices that follow them, to bones."""
    prepared = rig_limbs(character)
    found = None if prepared is None else prepared.limbs
    assert found is not None
    limbs = [
        Limb(chain.name, chain.points, ((),) * len(chain.points), parent=None if chain.name == TRUNK else TRUNK)
        for chain in found.chains
    ]
    names = [(limb.name, number) for limb in parents_first(limbs) for number in range(len(limb.points) - 1)]
    heads = dict(zip(names, bones_of(limbs).heads, strict=True))
    tails = dict(zip(names, bones_of(limbs).tails, strict=True))
    owners = tuple(names[bone] for bone in rig_bones(character, limbs).of_nodes(character).argmax(axis=1))
    which, share = vertex_influences(character)
    number = {bone: index for index, bone in enumerate(names)}
    owner = np.array([number[bone] for bone in owners])[which]
    shares = np.array([(share * (owner == index)).sum(axis=1) for index in range(len(names))])
    of_bone = {bone: np.flatnonzero(shares.argmax(axis=0) == index) for bone, index in number.items()}
    whole = {bone: np.flatnonzero(shares[index] > SINGLE_BONE_WEIGHT) for bone, index in number.items()}
    bones = {
        bone: (tails[bone] - heads[bone], whole[bone] if len(whole[bone]) >= 4 else of_bone[bone]) for bone in names
    }
    soles = {}
    for side in ("left", "right"):
        foot = next(whole for bone in (2, 1) if len(whole := of_bone[f"{side} leg", bone]))  # a foot may be of the shin
        height = character.vertices[foot, 1]
        soles[side] = foot[height < height.min() + 0.2 * np.ptp(height)]
    return Truth(bones, which, share, owners, soles)


@dataclass(frozen=True)
class Measured:
    """A character's poses of a recording: vertices (F, N, 3), motions (F, b, 4, 3), and the performer's joints."""

    frames: NDArray[np.int64]
    vertices: NDArray[np.float32]
    motions: NDArray[np.float64]
    all_feet: dict[str, NDArray[np.float64]]


def directions_only(puppet: Puppet) -> Puppet:
    """Return the puppet with hands that do not meet and feet that are not locked."""
    retarget = puppet.retarget.model_copy(update={"hands_meet": False})
    root = puppet.root and puppet.root.model_copy(update={"feet": "free"})
    return puppet.model_copy(update={"retarget": retarget, "root": root})


def play(prepared: PreparedCharacter, timeline: Timeline, soles: dict[str, NDArray[np.int64]]) -> Measured:
    """Play a recording; keep the vertices of some frames, and the centres of the soles in all frames."""
    motion = CharacterMotion(prepared, resting_pose(timeline, SETTINGS))
    count = len(timeline.positions)
    chosen = np.unique(np.linspace(0, count - 1, min(MEASURED_FRAMES, count)).astype(int))
    binding = BatchBinding(prepared.model, prepared.character.vertices, prepared.mesh.of_render)
    of_soles = {side: binding.only(numbers) for side, numbers in soles.items()}
    kept, motions, feet = [], [], {side: [] for side in soles}
    for number in range(count):
        pose = motion.step(timeline.frame(number))
        R = pose.R[None].astype(np.float32)
        for side, sole in of_soles.items():
            feet[side].append(sole.vertices(R)[:, :, 0].mean(axis=0) + pose.root)
        if number in chosen:
            kept.append(binding.vertices(R)[:, :, 0])
            motions.append(pose.bones)
    return Measured(chosen, np.array(kept), np.array(motions), {side: np.array(each) for side, each in feet.items()})


def directions(
    truth: Truth, rest: NDArray[np.float64], vertices: NDArray[np.float32]
) -> dict[tuple[str, int], NDArray[np.float64]]:
    """Return each bone's direction (F, 3) by the rotations that fit its vertices best."""
    found = {}
    for bone, (direction, members) in truth.bones.items():
        if len(members) >= 4:  # enough for a rotation
            before = rest[members] - rest[members].mean(axis=0)
            after = vertices[:, members] - vertices[:, members].mean(axis=1, keepdims=True)
            turned = [Rotation.align_vectors(pose, before)[0].apply(direction) for pose in after.astype(np.float64)]
            found[bone] = np.array(turned) / np.linalg.norm(direction)
    return found


def performer_directions(timeline: Timeline, frames: NDArray[np.int64]) -> dict[tuple[str, int], NDArray[np.float64]]:
    """Return the directions (F, 3) of the performer's bones, from joint to joint, in character axes."""
    joints = to_character_axes(timeline.positions[frames])
    found = {}
    for side in ("left", "right"):
        for limb, names in JOINTS.items():
            for number in range(2):
                start, end = (JOINT_INDEX[f"{name}_{side}"] for name in names[number : number + 2])
                found[f"{side} {limb}", number] = joints[:, end] - joints[:, start]
    found[TRUNK, 1] = joints[:, JOINT_INDEX["shoulder_center"]] - joints[:, JOINT_INDEX["spine"]]
    return {bone: way / np.linalg.norm(way, axis=1, keepdims=True) for bone, way in found.items()}


def angles(
    found: dict[tuple[str, int], NDArray[np.float64]], aims: dict[tuple[str, int], NDArray[np.float64]]
) -> dict[str, NDArray[np.float64]]:
    """Return the angles in degrees by kind of bone, after the best rotation of the whole recording."""
    bones = [bone for bone in aims if bone in found]
    there, here = np.concatenate([aims[bone] for bone in bones]), np.concatenate([found[bone] for bone in bones])
    known = np.isfinite(there).all(axis=1)
    tilt = Rotation.align_vectors(here[known], there[known])[0].as_rotvec()
    size = np.linalg.norm(tilt)
    turn = Rotation.from_rotvec(tilt * min(1.0, np.radians(MAX_TILT_DEGREES) / max(size, 1e-12)))
    result = {}
    for name, (limb, number) in SHOWN.items():
        chosen = [bone for bone in bones if bone[0].endswith(limb) and bone[1] == number]
        if not chosen:  # a machine without arms
            result[name] = np.zeros(0)
            continue
        cosine = np.concatenate(
            [np.einsum("fx,fx->f", turn.apply(np.nan_to_num(aims[bone])), found[bone]) for bone in chosen]
        )
        sure = np.concatenate([np.isfinite(aims[bone]).all(axis=1) for bone in chosen])
        result[name] = np.degrees(np.arccos(np.clip(cosine[sure], -1, 1)))
    return result


def skinned(truth: Truth, prepared: PreparedCharacter, motions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vertices (F, N, 3) by linear blend skinning, in which each rig joint moves with its bone."""
    numbers = {}
    for limb in prepared.puppet.limbs:
        for number in range(len(limb.points) - 1):
            start = np.linalg.norm(bones_of(prepared.puppet.limbs).heads - limb.points[number], axis=1)
            end = np.linalg.norm(bones_of(prepared.puppet.limbs).tails - limb.points[number + 1], axis=1)
            numbers[limb.name, number] = int((start + end).argmin())
    of_joint = np.array([numbers.get(bone, numbers["trunk", 0]) for bone in truth.owner])
    rest = np.column_stack([prepared.character.vertices, np.ones(len(prepared.character.vertices))])
    blend = np.zeros((len(motions), len(rest), 3))
    for column in range(truth.which.shape[1]):
        bone = of_joint[truth.which[:, column]]
        for number in np.unique(bone):
            chosen = bone == number
            moved = np.einsum("nr,frx->fnx", rest[chosen], motions[:, number])
            blend[:, chosen] += truth.share[chosen, column, None] * moved
    return blend


def stretch(rest: NDArray[np.float64], poses: NDArray[np.floating], edges: NDArray[np.int64]) -> str:
    """Return the 1st and 99th percentile of edge lengths relative to the rest pose."""
    at_rest = np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1)
    kept = at_rest > 1e-6 * at_rest.max()
    lengths = np.linalg.norm(poses[:, edges[kept, 0]] - poses[:, edges[kept, 1]], axis=-1)
    low, high = np.percentile(lengths / at_rest[kept], (1, 99))
    return f"{low:.2f} / {high:.2f}"


def standing(timeline: Timeline, side: str) -> list[NDArray[np.int64]]:
    """Return runs of frames in which a foot of the performer stands."""
    ankle = timeline.positions[:, JOINT_INDEX[f"ankle_{side}"]]
    smooth = np.array([np.median(ankle[max(0, k - 2) : k + 3], axis=0) for k in range(len(ankle))])
    speed = np.linalg.norm(np.gradient(smooth, 1 / timeline.fps, axis=0), axis=1)
    still = (speed < MAX_STANDING_SPEED) & (smooth[:, 1] < np.nanmin(smooth[:, 1]) + MAX_STANDING_HEIGHT)
    runs = np.split(np.flatnonzero(still), np.flatnonzero(np.diff(np.flatnonzero(still)) > 1) + 1)
    return [run for run in runs if len(run) >= MIN_STANDING_FRAMES]


def feet(timeline: Timeline, shown: Measured, rest: NDArray[np.float64], soles: dict[str, NDArray[np.int64]]) -> str:
    """Return 95th percentiles of sliding and height while standing, in % of the character's height."""
    height = np.ptp(rest[:, 1])
    slides, heights = [], []
    for side, places in shown.all_feet.items():
        floor = rest[soles[side], 1].mean()
        for run in standing(timeline, side):
            there = places[run]
            slides.append(np.linalg.norm((there - there.mean(axis=0))[:, [0, 2]], axis=1))
            heights.append(np.abs(there[:, 1] - floor))
    if not slides:
        return "–"
    slide, away = (100 * np.percentile(np.concatenate(each), 95) / height for each in (slides, heights))
    return f"{slide:.1f} / {away:.1f}"


def noise(timeline: Timeline) -> str:
    """Return the angles between the recording's own limbs and those of the median of three frames."""
    frames = np.arange(len(timeline.positions))
    around = timeline.positions[np.clip(frames + np.array([[-1], [0], [1]]), 0, frames[-1])]
    calm = performer_directions(replace(timeline, positions=np.median(around, axis=0)), frames)
    cosines = [np.einsum("fx,fx->f", way, calm[bone]) for bone, way in performer_directions(timeline, frames).items()]
    cosine = np.concatenate(cosines)
    return median_and_p95(np.degrees(np.arccos(np.clip(cosine[np.isfinite(cosine)], -1, 1))))


def hands_together(timeline: Timeline) -> str:
    """Return the percentage of frames in which the performer's hands are so near that the character's meet."""
    left, right = (timeline.positions[:, JOINT_INDEX[f"hand_{side}"]] for side in ("left", "right"))
    lengths = body.bone_lengths(resting_pose(timeline, SETTINGS))
    arm = np.mean([lengths[f"elbow_{side}"] + lengths[f"wrist_{side}"] for side in ("left", "right")])
    return f"{100 * np.mean(np.linalg.norm(left - right, axis=1) < APART_ARM_LENGTHS * arm):.0f}"


def median_and_p95(values: NDArray[np.float64], digits: int = 1) -> str:
    return f"{np.median(values):.{digits}f} / {np.percentile(values, 95):.{digits}f}" if len(values) else "–"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--sheets", type=Path)
    parser.add_argument("--characters", nargs="*", default=CHARACTERS)
    parser.add_argument("--recordings", nargs="*", default=RECORDINGS)
    parser.add_argument("--limbs", nargs="*", default=LIMB_SOURCES, choices=LIMB_SOURCES)
    parser.add_argument("--directions-only", action="store_true")
    options = parser.parse_args()
    if options.sheets:
        options.sheets.mkdir(parents=True, exist_ok=True)
    print(
        "| character | limbs from | recording | upper arms, ° | forearms | thighs | shins | trunk "
        "| noise of the log, ° | hands together, % | edges p1 / p99 | those of skinning | distance, % median / 95 % "
        "| feet: sliding / height, % |"
    )
    print(f"|{' --- |' * 14}")
    totals: dict[str, list[NDArray[np.float64]]] = {}
    away: list[NDArray[np.float64]] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in options.characters:
            source = options.data / "mesh" / "gltf" / f"{name}.glb"
            character = load_character(source)
            truth = read_rig(character)
            bare = Path(folder) / f"{name}.glb"
            make_character(name, character.vertices, character.triangles).document.save(bare)
            for kind in options.limbs:
                file = source if kind == "rig" else bare
                puppet = Path(folder) / f"{name}_{kind}.toml"
                proposed = new_puppet(file, puppet, limbs=kind != "none").puppet
                puppet.write_text(puppet_file.dumps(directions_only(proposed) if options.directions_only else proposed))
                prepared = load_prepared(puppet)
                rest = prepared.character.vertices
                for recording in options.recordings:
                    timeline, notes = load_timeline(options.data / "logs" / recording, SETTINGS)
                    sensor = recording.partition("/")[0]
                    shown = play(prepared, timeline, truth.soles)
                    found = angles(
                        directions(truth, rest, shown.vertices), performer_directions(timeline, shown.frames)
                    )
                    totals.setdefault(kind, []).extend(found.values())
                    edges = prepared.character.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
                    reference = ["–", "–"]
                    if kind == "rig":
                        own = skinned(truth, prepared, shown.motions)
                        away.append(
                            100 * np.linalg.norm(shown.vertices - own, axis=-1).ravel() / prepared.mesh.diagonal
                        )
                        reference = [stretch(rest, own, edges), median_and_p95(away[-1], 2)]
                    cells = [
                        name,
                        kind,
                        sensor,
                        *(median_and_p95(found[each]) for each in SHOWN),
                        noise(timeline),
                        hands_together(timeline),
                        stretch(rest, shown.vertices, edges),
                        *reference,
                        feet(timeline, shown, rest, truth.soles),
                    ]
                    print(f"| {' | '.join(cells)} |", flush=True)
                    if options.sheets:
                        clip = perform(prepared, timeline, SETTINGS, notes, lambda _stage, _share: None)
                        title = f"{name}, {sensor}, limbs from the {kind}"
                        clip_sheet.draw(clip, options.sheets / f"{name}_{kind}_{sensor}.png", title)
    for kind, values in totals.items():
        print(f"\nAll limbs, limbs from the {kind}: {median_and_p95(np.concatenate(values))}°")
    if away:
        print(f"\nDistance to skinning: {median_and_p95(np.concatenate(away), 3)} %")


if __name__ == "__main__":
    main()
