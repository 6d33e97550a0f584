"""Record the test vectors anew: ``python tests/vectors/record.py``. What they are stands in README.md."""

import json
from pathlib import Path

import igl
import numpy as np

from capture.skeleton import SkeletonFrame
from engine_bridge.character.character import make_character
from engine_bridge.character.preparation import prepare
from engine_bridge.export.live_basis import REACH, LiveBasis
from engine_bridge.performance.pose import Pose
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.puppet import puppet_file
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.header import FRAME_KINDS, Header, Kind, join, topic, topic_field, write_json
from engine_bridge.service.protocol.payloads import decode, encode
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.states import STATES
from solver.motion.deformer import Deformer
from solver.motion.limbs import bones_of
from solver.motion.motion_blend import moved_by

HERE = Path(__file__).parent

PUPPET = {
    "character": {"mesh": "worm.glb", "up": "y", "front": "z", "scale": 0.5},
    "handle": [
        {"name": "head", "position": [2.16, 3.0, 0.0], "joint": "head"},
        {"name": "left side", "position": [1.0, 0.0, 0.0], "joints": ["hand_left", "wrist_left"]},
        {"name": "tail", "position": [0.54, -3.0, 0.0]},
    ],
    "solver": {"fields": 4, "isolines": 5},
}
"""A ball of 162 vertices, drawn out to a bent worm."""

PULLS = [
    [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
    [[1.5, -0.5, 0.8], [0.4, 0.1, 0.0], [0.0, 0.0, 0.0]],
    [[-0.7, 0.3, -1.0], [0.0, 0.0, 0.6], [0.5, 0.2, 0.9]],
]
"""Where the handles go in each frame; in the first they stay where they are."""

IN_BETWEEN = [[-0.5, 0.0, -0.6], [0.0, 0.0, 0.5], [0.3, 0.0, 0.7]]
"""Where they go along the second direction of the morph basis, the first being the second frame: the third leaves a
rest."""


LIMB = {
    "name": "trunk",
    "points": [[0.45, -2.4, 0.0], [0.0, 0.0, 0.0], [1.28, 2.4, 0.0]],
    "joints": ["hip_center", "spine", "shoulder_center"],
}
"""The limb of a second character, which has the worm's mesh and its first handle."""

BEND = [[0.0, 0.0, -0.5], [0.0, 0.7, 0.4]]
"""Rotation vector of each of its bones relative to the bone's parent."""


def worm(puppet: dict[str, object] = PUPPET) -> PreparedCharacter:
    """Make the character of a puppet."""
    vertices, faces = igl.upsample(*igl.icosahedron(), 2)
    vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True) * [1.0, 3.0, 1.0]
    vertices[:, 0] += 0.15 * vertices[:, 1] ** 2
    vertices[:, [0, 2]] *= 1 + 0.2 * vertices[:, 1:2]
    vertices = vertices.astype(np.float32).astype(np.float64)
    colors = np.clip(vertices * [0.3, 0.15, 0.3] + 0.5, 0, 1)
    checked = puppet_file.check(puppet, "worm")
    character = make_character("worm", vertices, faces, colors)
    given = character.vertices, character.triangles, checked.solver.parameters, None, "worm"
    return PreparedCharacter(checked, character, *prepare(*given, bones=bones_of(checked.limbs)))


def frames() -> list[Frame]:
    """Pull the character about."""
    prepared = worm()
    deformer = Deformer(prepared.model, prepared.mesh, prepared.puppet.handle_positions)
    poses = [deformer.solve(deformer.handles + pull).copy() for pull in PULLS]
    targets = [poses[1], deformer.solve(deformer.handles + IN_BETWEEN)]
    basis = LiveBasis(np.array([pose - poses[0] for pose in targets], dtype=np.float32), REACH, prepared.model)
    character = StreamedCharacter("worm", prepared, 7, basis)
    return [
        Frame(
            character=character,
            sequence=41 + number,
            time=12.5 + number / 30,
            received=1_000_000_000 + 33_333_333 * number,
            state=STATES[number],
            user=None if number == 0 else 3,
            pose=Pose(
                targets=deformer.handles + PULLS[number],
                bones=np.zeros((0, 4, 3)),
                root=np.array([0.25, 0.0, -0.125]) * number,
                R=R,
                model=prepared.model,
            ),
            seen=None if number == 0 else seen(number),
        )
        for number, R in enumerate(poses)
    ]


def seen(number: int) -> SkeletonFrame:
    """Return the joints of the performer in a frame."""
    joints = np.arange(60.0).reshape(20, 3) / 8 + number
    return SkeletonFrame(0.0, 3, joints, np.linspace(0, 1, 20, dtype=np.float32))


def limbed_frame() -> Frame:
    """Bend the limb of the second character."""
    prepared = worm(PUPPET | {"handle": PUPPET["handle"][:1], "limb": [LIMB]})
    deformer = Deformer(prepared.model, prepared.mesh, prepared.puppet.handle_positions)
    apart = np.column_stack([BEND, np.zeros((2, 3))])
    motions = moved_by(deformer.bones, np.tile(np.eye(4, 3), (2, 1, 1)), apart, 1.0)
    return Frame(
        character=StreamedCharacter("limbed", prepared, 8),
        sequence=44,
        time=12.6,
        received=1_100_000_000,
        state=STATES[1],
        user=3,
        pose=Pose(
            targets=deformer.handles - np.array([0.25, 0.0, -0.125]),
            bones=motions,
            root=np.array([0.25, 0.0, -0.125]),
            R=deformer.solve(deformer.handles, motions),
            model=prepared.model,
            channels={"mouth_open": 0.25, "voice": 1.0},
        ),
    )


def json_message(name: str, kind: Kind, value: object, **header: int) -> bytes:
    payload = write_json(value)
    return join(topic_field(name), Header(kind=kind, length=len(payload), **header), payload)


def messages() -> dict[str, bytes]:
    """Return every message by the name of its file."""
    played = frames()
    character = played[0].character
    scene = Header(kind=Kind.SCENE, length=len(character.scene), revision=character.revision, published=5)
    made = {"scene": join(topic("worm", Kind.SCENE), scene, character.scene)}
    limbed = limbed_frame()
    described = Header(kind=Kind.SCENE, length=len(limbed.character.scene), revision=8, published=5)
    made["limbed.scene"] = join(topic("limbed", Kind.SCENE), described, limbed.character.scene)
    for kind in (Kind.BONES, Kind.CHANNELS):
        made[f"limbed.{kind.word}"] = encode(kind, limbed, limbed.received + 2_000_000)
    for number, frame in enumerate(played):
        for kind in FRAME_KINDS:
            message = encode(kind, frame, frame.received + 2_000_000)
            if message is not None:
                made[f"{number}.{kind.word}"] = message
    performer = {"character": "worm", "state": "calibrating", "user": 3, "time": played[1].time}
    made["performer"] = json_message("worm/performer", Kind.PERFORMER, performer, revision=7, state=1, user=3)
    # the worm has no limbs, and channels are younger
    kinds = [kind.word for kind in FRAME_KINDS if kind not in (Kind.BONES, Kind.CHANNELS)]
    listed = [{"name": "worm", "revision": 7, "digest": character.digest, "vertices": 162, "kinds": kinds}]
    made["characters"] = json_message("service/characters", Kind.CHARACTERS, listed)
    return made


def expected(message: bytes) -> dict[str, object]:
    """Say what a message holds: its topic, its header, and all of what is small or the ends of what is not."""
    received = decode(message)
    header = received.header._asdict()
    assert header.pop("targets") == 0  # the mesh has no morph targets of its own
    body = received.body
    match received.header.kind:
        case Kind.SCENE:
            held = {"facts": body.facts, "arrays": {name: ends(array) for name, array in body.arrays.items()}}
        case Kind.MORPHS:
            held = {"residual": body.residual, "weights": body.weights.tolist()}
        case Kind.VERTICES | Kind.VERTICES16:
            held = {"positions": ends(body.positions), "normals": ends(body.normals)}
        case Kind.CONTROLS | Kind.JOINTS | Kind.HANDLES | Kind.BONES:
            held = {"values": ends(body)}
        case _:
            held = {"json": body}
    return {"topic": received.topic, "header": header, **held}


def ends(array: np.ndarray) -> dict[str, object]:
    """Return an array's shape, its first and its last row."""
    return {"shape": list(array.shape), "first": array[0].tolist(), "last": array[-1].tolist()}


def main() -> None:
    for old in HERE.glob("*.bin"):
        old.unlink()
    made = messages()
    for name, message in made.items():
        (HERE / f"{name}.bin").write_bytes(message)
    lines = (f"{json.dumps(name)}: {json.dumps(expected(message))}" for name, message in made.items())
    (HERE / "expected.json").write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
