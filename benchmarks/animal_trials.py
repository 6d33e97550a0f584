"""Animals beside their own Walk, and their gestures: a made performer glides, and raises hands above the head.

    python -m benchmarks.animal_trials --data FOLDER [--only NAME …]

The first table compares the strides of an animal with those of the animation Walk in its file, at the same speed, and
with dynamic similarity: a stride of 2.3 L Fr^0.3 (Alexander 1976). The sensor does not see the performer's feet, so
that cadence and length follow from the speed alone. The second table is of animals whose arms, wings or front legs
follow a hand: how far the tip of that limb rises, as a share of the height of its root for legs, and how far it moves,
as a share of its length, for other limbs; and edge lengths relative to rest.
"""

import argparse
import math
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.animals import ANIMALS, soles_of
from capture import body
from capture.skeleton import JOINT_INDEX, JOINTS, SkeletonFrame
from engine_bridge.character.character import CharacterMesh, from_document
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.prepared_character import PreparedCharacter, make_prepared
from engine_bridge.puppet.body_plans import is_leg
from engine_bridge.puppet.proposal import new_puppet
from puppetline.errors import PuppetlineError
from solver.model.batch import BatchBinding
from solver.model.stretch import EdgeStretch
from solver.motion.gait import GRAVITY, STRIDE_FACTOR, STRIDE_POWER
from solver.motion.limbs import parents_first
from solver.motion.steps import Steps

FPS, SAMPLES = 30.0, 48
"""Rate of the made performer, and number of frames at which an animation is measured."""

WALK_SECONDS, SETTLE_SECONDS = 12.0, 4.0
"""Length of a walk, and of its beginning that does not count."""

HANDS = {"left": ("left",), "right": ("right",), "both": ("left", "right")}

Floats = NDArray[np.float64]


class Stride(NamedTuple):
    """Seconds per stride, share of time on the floor, length in leg lengths, and height of a swing in leg lengths."""

    period: float
    duty: float
    length: float
    rise: float


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=list(ANIMALS))
    chosen = parser.parse_args()
    meshes = sorted(path for path in (chosen.data / "mesh").rglob("*") if path.suffix in (".glb", ".obj", ".off"))
    characters = {}
    for mesh in (path for path in meshes if any(part in path.stem for part in chosen.only)):
        with tempfile.TemporaryDirectory() as folder:
            try:
                proposal = new_puppet(mesh, Path(folder) / "puppet.toml")
            except PuppetlineError:
                continue
            characters[mesh.stem] = make_prepared(proposal.puppet, proposal.character)
    print("| character | Froude number | period: own, ours | duty factor: own, ours | stride / leg: own, ours, similar "
          "| swing height / leg: own, ours |\n| --- | --- | --- | --- | --- | --- |")  # fmt: skip
    for name, prepared in characters.items():
        compare_walk(name, prepared)
    print("\n| character | hand | limb | way | edges p1 | p99 |\n| --- | --- | --- | --- | --- | --- |")
    for name, prepared in characters.items():
        for hand in HANDS:
            raise_hands(name, prepared, hand)


def compare_walk(name: str, prepared: PreparedCharacter) -> None:
    """Print the row of an animal that has an animation Walk."""
    steps = CharacterMotion(prepared, performer(0.0)).performer._grounding
    found = own_walk(prepared)
    if found is None or not isinstance(steps, Steps):
        return
    speed, length = found
    leg, metre = steps._plan.leg_length, steps.metre
    froude = speed**2 / (GRAVITY * metre * leg)
    similar = STRIDE_FACTOR * froude**STRIDE_POWER
    own, ours = length, walk(prepared, speed / metre)
    print(
        f"| {name} | {froude:.2f} | {own.period:.2f}, {ours.period:.2f} s | {own.duty:.2f}, {ours.duty:.2f} "
        f"| {own.length:.2f}, {ours.length:.2f}, {similar:.2f} | {own.rise:.2f}, {ours.rise:.2f} |",
        flush=True,
    )


def own_walk(prepared: PreparedCharacter) -> tuple[float, Stride] | None:
    """Return the speed, mesh units per second, and strides of the file's animation Walk, which walks on the spot."""
    gltf = prepared.character.document.gltf
    walks = [each for each in gltf.get("animations", []) if each.get("name", "").lower().endswith("walk")]
    soles = soles_of(prepared)
    if not walks or not soles:
        return None
    inputs = [prepared.character.document.array(sampler["input"]).ravel() for sampler in walks[0]["samplers"]]
    seconds = float(max(times[-1] for times in inputs) - min(times[0] for times in inputs))
    shown = np.unique(prepared.mesh.of_render, return_index=True)[1]
    basis = prepared.puppet.character.basis
    leg = leg_length(prepared)
    poses = [
        posed(prepared.character, walks[0], share * seconds).vertices[shown] for share in np.arange(SAMPLES) / SAMPLES
    ]
    feet = np.array([[(pose[sole] @ basis.T).mean(axis=0) for sole in soles] for pose in poses])
    low = np.array([[(pose[sole] @ basis[1]).min() for sole in soles] for pose in poses])
    rises = np.ptp(low, axis=0)
    ahead = np.roll(feet[..., 2], -1, axis=0) - feet[..., 2]
    stands = ahead < 0  # on the spot, feet that stand move backwards
    speed = float(-ahead[stands].mean()) * SAMPLES / seconds
    begins = [np.count_nonzero(one & ~np.roll(one, 1)) for one in stands.T]
    strides = max(1, round(float(np.median(begins))))
    period = seconds / strides
    return speed, Stride(period, float(stands.mean()), speed * period / leg, float(np.median(rises)) / leg)


def leg_length(prepared: PreparedCharacter) -> float:
    """Return the mean height of the hips over the tips of the legs, mesh units."""
    legs = [limb.points for limb in prepared.puppet.limbs if is_leg(limb.name)]
    return float(np.mean([(np.array(leg[0]) - np.array(leg[-1])) @ prepared.puppet.character.basis[1] for leg in legs]))


def posed(character: CharacterMesh, animation: dict, time: float) -> CharacterMesh:
    """Return a character in the pose of an animation at a time."""
    document = character.document.copy()
    for channel in animation["channels"]:
        sampler, path = animation["samplers"][channel["sampler"]], channel["target"]["path"]
        if path == "weights":
            continue
        times = document.array(sampler["input"]).ravel()
        values = document.array(sampler["output"]).astype(np.float64)
        row = np.array([np.interp(time + times[0], times, column) for column in values.T])
        document.gltf["nodes"][channel["target"]["node"]][path] = row.tolist()
    return from_document(document)


def performer(raised: float, hands: tuple[str, ...] = ()) -> Floats:
    """Return an upright performer (20, 3), sensor coordinates, with hands raised from hanging, 0, to the top, 1."""
    pose = body.upright(np.array([PLACES[joint] for joint in JOINTS]))
    for side in hands:
        shoulder = pose[JOINT_INDEX[f"shoulder_{side}"]]
        arm = [JOINT_INDEX[f"{joint}_{side}"] for joint in ("elbow", "wrist", "hand")]
        turn, out = math.pi * 0.95 * raised, -1.0 if side == "left" else 1.0
        lengths = np.linalg.norm(pose[arm] - shoulder, axis=1)
        # forwards and a little outwards, as a person waves
        way = np.array([0.35 * out * math.sin(turn), -math.cos(turn), -math.sin(turn)])
        pose[arm] = shoulder + lengths[:, None] * way / np.linalg.norm(way)
    return pose


def _places() -> dict[str, Floats]:
    centre = {"hip_center": 0.0, "spine": 0.07, "shoulder_center": 0.41, "head": 0.61}
    places = {joint: np.array([0.0, high, 2.5]) for joint, high in centre.items()}
    sides = {"shoulder": (0.18, 0.36), "elbow": (0.22, 0.10), "wrist": (0.26, -0.14), "hand": (0.27, -0.22),
             "hip": (0.09, -0.04), "knee": (0.09, -0.52), "ankle": (0.09, -0.90), "foot": (0.09, -0.95)}  # fmt: skip
    for joint, (out, high) in sides.items():
        for side, sign in (("left", -1.0), ("right", 1.0)):
            places[f"{joint}_{side}"] = np.array([sign * out, high, 2.5 - (0.1 if joint == "foot" else 0.0)])
    return places


PLACES = _places()


def frames(poses: list[Floats], hidden: tuple[str, ...] = ()) -> list[SkeletonFrame]:
    """Return frames of poses; the sensor does not see the `hidden` joints."""
    confidence = np.ones(len(JOINTS), dtype=np.float32)
    confidence[[JOINT_INDEX[joint] for joint in hidden]] = 0.0
    return [SkeletonFrame(number / FPS, 0, pose, confidence) for number, pose in enumerate(poses)]


def walk(prepared: PreparedCharacter, speed: float) -> Stride:
    """Return the strides of a character whose performer walks towards the sensor, in metres per second."""
    count, still = round(WALK_SECONDS * FPS), performer(0.0)
    poses = [still - np.array([0.0, 0.0, speed * number / FPS]) for number in range(count)]
    retargeting = CharacterMotion(prepared, still).performer
    steps = retargeting._grounding
    assert isinstance(steps, Steps)
    hidden = ("ankle_left", "ankle_right", "foot_left", "foot_right", "knee_left", "knee_right")
    swinging, heights = [], []
    for frame in frames(poses, hidden):
        retargeting.step(frame)
        swinging.append(steps.swinging)
        heights.append(steps._state.place @ prepared.puppet.character.basis[1])
    settled = np.array(swinging)[round(SETTLE_SECONDS * FPS) :]
    rises = np.ptp(np.array(heights)[round(SETTLE_SECONDS * FPS) :], axis=0)
    starts = [np.flatnonzero(~one[:-1] & one[1:]) for one in settled.T]
    period = float(np.median(np.concatenate([np.diff(one) for one in starts]))) / FPS
    units = speed * steps.metre * period / steps._plan.leg_length
    return Stride(period, 1 - float(settled.mean()), units, float(np.median(rises)) / steps._plan.leg_length)


def raise_hands(name: str, prepared: PreparedCharacter, which: str) -> None:
    """Print how far the limbs rise that follow raised hands."""
    mirrored = prepared.puppet.retarget.mirror
    still = performer(0.0)
    shares = np.concatenate([np.zeros(15), np.linspace(0, 1, 15), np.ones(45)])
    poses = [performer(0.5 - 0.5 * math.cos(math.pi * share), HANDS[which]) for share in shares]
    motion = CharacterMotion(prepared, still)
    surface, stretch = BatchBinding.of_solver_mesh(prepared.model, prepared.mesh), EdgeStretch(prepared.mesh)
    up, first, watched = prepared.puppet.character.basis[1], 0, []
    for limb in parents_first(prepared.puppet.limbs):
        last = first + len(limb.points) - 2
        side = limb.name.split()[0]
        own = side if not mirrored else {"left": "right", "right": "left"}.get(side, side)
        moves = limb.name.split()[-1] in ("arm", "wing") or "front leg" in limb.name or limb.name.endswith("leg 1")
        if moves and own in HANDS[which]:
            root, tip = np.array(limb.points[0]), np.array(limb.points[-1])
            reach = float((root - tip) @ up) if is_leg(limb.name) else float(np.linalg.norm(tip - root))
            watched.append((limb.name, last, tip, reach))
        first = last + 1
    highest = np.full(len(watched), -np.inf)
    for frame in frames(poses):
        pose = motion.step(frame)
        stretch.add(surface.vertices(pose.R[None].astype(np.float32)))
        for number, (_, bone, tip, _) in enumerate(watched):
            there = tip @ pose.bones[bone, :3] + pose.bones[bone, 3] + pose.root
            way = (there - tip) @ up if is_leg(watched[number][0]) else np.linalg.norm(there - tip)
            highest[number] = max(highest[number], float(way))
    low, high = stretch.percentiles(1, 99)
    for (limb_name, _, _, reach), rise in zip(watched, highest, strict=True):
        print(f"| {name} | {which} | {limb_name} | {100 * rise / reach:.0f} % | {low:.2f} | {high:.2f} |", flush=True)


if __name__ == "__main__":
    main()
