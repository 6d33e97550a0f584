"""BVH files of a body, for the tests."""

import numpy as np

ROTATIONS = ("Zrotation", "Yrotation", "Xrotation")
POSITIONS = ("Xposition", "Yposition", "Zposition")

# A body of 1.7 m in centimetres: name, offset and children, the arms hanging. Facing +z: its left is at +x.
BODY = ("Hips", (0, 0, 0), [
    ("Spine", (0, 10, 0), [
        ("Neck", (0, 40, 0), [("Head", (0, 10, 0), [("", (0, 20, 0), [])])]),
        ("LeftShoulder", (3, 38, 0), [("LeftArm", (15, 0, 0), [("LeftForeArm", (0, -28, 0), [
            ("LeftHand", (0, -25, 0), [("", (0, -8, 0), [])])])])]),
        ("RightShoulder", (-3, 38, 0), [("RightArm", (-15, 0, 0), [("RightForeArm", (0, -28, 0), [
            ("RightHand", (0, -25, 0), [("", (0, -8, 0), [])])])])]),
    ]),
    ("LeftUpLeg", (9, -5, 0), [("LeftLeg", (0, -41, 0), [("LeftFoot", (0, -41, 0), [
        ("LeftToeBase", (0, -6, 14), [("", (0, 0, 6), [])])])])]),
    ("RightUpLeg", (-9, -5, 0), [("RightLeg", (0, -41, 0), [("RightFoot", (0, -41, 0), [
        ("RightToeBase", (0, -6, 14), [("", (0, 0, 6), [])])])])]),
])  # fmt: skip
JOINT_COUNT = 20


def hierarchy(tree, z_up=False, scale=1, channels=ROTATIONS, depth=0):
    name, offset, children = tree
    x, y, z = np.multiply(offset, scale).tolist()
    lines = [
        f"{'ROOT' if depth == 0 else 'JOINT'} {name}" if name else "End Site",
        "{",
        f"\tOFFSET {x} {-z if z_up else y} {y if z_up else z}",
    ]
    if name:
        own = (*POSITIONS, *channels) if depth == 0 else channels
        lines.append(f"CHANNELS {len(own)} {' '.join(own)}")
    for child in children:
        lines += hierarchy(child, z_up, scale, channels, depth + 1)
    return [*lines, "}"]


def motion(rows):
    return ["MOTION", f"Frames: {len(rows)}", "Frame Time: 0.04", *(" ".join(map(repr, row)) for row in rows.tolist())]


def still(frames=2):
    """Return a recording of the rest pose; the columns are root x y z, then z y x degrees of each joint."""
    return np.zeros((frames, 3 + 3 * JOINT_COUNT))


def random_rows(frames=6, seed=3):
    """Return a recording of small bends."""
    rows = np.random.default_rng(seed).uniform(-35, 35, (frames, 3 + 3 * JOINT_COUNT))
    rows[:, 3:6] /= 10
    return rows


def lines_of(rows, tree=BODY, **changes):
    return ["HIERARCHY", *hierarchy(tree, **changes), *motion(rows)]


def joints_in(lines):
    """Return the names of the joints in the order of their columns."""
    return [line.split()[1] for line in lines if line.startswith(("ROOT", "JOINT"))]


def body_file(folder, rows):
    (folder / "take.bvh").write_text("\n".join(lines_of(rows)) + "\n")
    return folder / "take.bvh"


def animal_leg(name, x, z):
    side = "Left" if x > 0 else "Right"
    joints = {"Hind": ("UpLeg", "Leg", "Foot", "ToeBase"), "Front": ("Arm", "ForeArm", "Hand", "HandIndex1")}[name]
    tree = ("", (0, 0, 4), [])
    for joint, offset in zip(joints[::-1], ((0, -6, 5), (0, -25, 0), (0, -25, 0), (x, -5, z)), strict=True):
        tree = (f"{side}{joint}", offset, [tree])
    return tree


ANIMAL = ("Hips", (0, 0, 0), [
    ("Spine", (0, 0, 20), [("Neck", (0, 5, 45), [("Head", (0, 20, 15), [("", (0, 0, 20), [])])]),
                           animal_leg("Front", 9, 35), animal_leg("Front", -9, 35)]),
    animal_leg("Hind", 9, 0), animal_leg("Hind", -9, 0),
])  # fmt: skip


def animal_lines(rows=None):
    """Return an animal on four legs that stands still, or moves."""
    return lines_of(np.zeros((3, 3 + 3 * len(joints_in(hierarchy(ANIMAL))))) if rows is None else rows, ANIMAL)


def animal_file(folder, name):
    (folder / name).write_text("\n".join(animal_lines()) + "\n")
