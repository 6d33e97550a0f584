"""Random tables of a person's joints, and whether a reader reads them right."""

import numpy as np
from scipy.spatial.transform import Rotation

from capture.body import bone_lengths
from capture.formats import read_log
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.errors import SkeletonLogError

from .people import LIMBS, person

V2 = {"hip_center": "spine_base", "spine": "spine_mid", "shoulder_center": "spine_shoulder"}
OPTIONAL = {"hand_left", "foot_right", "ankle_left", "knee_right", "spine", "head"}

CLOCKS = [("time", 1 / 30, 4), ("Timestamp (ms)", 1000 / 30, 0), ("ticks", 1e7 / 30, 0), ("frame", 1, 0)]
"""Names of columns, steps between frames, and decimals."""

SPELLINGS = (
    "{word}_{axis}",
    "{word}.{axis}",
    "{camel}{AXIS}",
    "{camel} Position {AXIS}",
    "{AXIS}_{word}",
    "{word}.position.{axis}",
    "{WORD} ({axis})",
)
"""Ways in which programs write a column's name."""
TWO_ROWS = len(SPELLINGS)
"""The style of a table with names in one row and axes in the next."""


def side_first(joint):
    return "_".join(joint.split("_")[::-1]) if joint.endswith(("left", "right")) else joint


def names_of(rng):
    """Return the words for the joints that a table has."""
    own = dict(zip(JOINTS, JOINTS, strict=True))
    sided = {joint: side_first(joint) for joint in JOINTS}
    names = [own, own | V2, {JOINTS[at]: sided[JOINTS[at]] for at in LIMBS} | {"head": "nose"}, sided][rng.integers(4)]
    joints = rng.permutation([*names]).tolist()
    if rng.random() < 0.3:
        joints.remove(next(joint for joint in joints if joint in OPTIONAL))
    return {joint: names[joint] for joint in joints}


def spelled(style, word, axis):
    camel = "".join(part.title() for part in word.split("_"))
    return SPELLINGS[style].format(word=word, WORD=word.upper(), camel=camel, axis=axis, AXIS=axis.upper())


def moved(rng, poses, unit):
    """Return poses in other axes and another unit."""
    turn = Rotation.from_euler("y", rng.uniform(-180, 180), degrees=True).as_matrix()
    axes = [(0, 1, 2), (2, 0, 1), (0, 2, 1)][rng.integers(3)]
    return unit * ((poses @ turn.T)[..., axes] * rng.choice([-1.0, 1.0], 3) + rng.normal(size=3) * rng.integers(0, 2))


def laid_out(rng, form, style, names, points):
    """Return header rows, and a list of rows without their time for each frame; `points` (T, J, 3) are texts."""
    if form == "long":
        return [["joint", "x", "y", "z"]], [
            [[name, *point] for name, point in zip(names, pose, strict=True)] for pose in points
        ]
    if form == "cells":
        begin, end = [("", ""), ("[", "]"), ("(", ")")][rng.integers(3)]
        return [names], [[[f"{begin}{' '.join(point)}{end}" for point in pose]] for pose in points]
    if style == TWO_ROWS:
        heads = [[cell for name in names for cell in (name, "", "")], list("XYZ") * len(names)]
    else:
        heads = [[spelled(style, name, axis) for name in names for axis in "xyz"]]
    order = np.arange(3 * len(names))
    if style != TWO_ROWS and rng.random() < 0.5:
        rng.shuffle(order)
    return [[head[at] for at in order] for head in heads], [[pose.ravel()[order].tolist()] for pose in points]


def table(seed):
    """Return the text of a random table, the positions (T, 20, 3) in it, None if it is damaged, and its joints."""
    rng = np.random.default_rng(seed)
    poses = person(int(rng.integers(4, 12))) * rng.uniform(0.75, 1.12)
    names, unit = names_of(rng), float(rng.choice([1.0, 100.0, 1000.0]))
    title, step, decimals = CLOCKS[rng.integers(4)]
    separator, comma = str(rng.choice([",", ";", "\t", " "])), rng.random() < 0.3
    style, form = int(rng.integers(TWO_ROWS + 1)), str(rng.choice(["wide", "wide", "wide", "cells", "long"]))
    if separator == " " and (form == "cells" or style in (3, 6, TWO_ROWS)):
        separator = ";"
    mark = "," if comma and separator != "," and form != "cells" else "."
    own = moved(rng, poses, unit)[:, [JOINT_INDEX[joint] for joint in names]]
    points = np.vectorize(lambda value: f"{value:.{6 if unit == 1 else 3}f}".replace(".", mark), otypes=[object])(own)
    heads, frames = laid_out(rng, form, style, [*names.values()], points)
    moments = [f"{(9 + index) * step:.{decimals}f}".replace(".", mark) for index in range(len(poses))]
    rows = [[moment, *row] for moment, frame in zip(moments, frames, strict=True) for row in frame]
    heads = [[title if level == 0 else "", *head] for level, head in enumerate(heads)]
    if separator == " ":
        heads = [[cell.replace(" ", "_") for cell in head] for head in heads]
    damage = rng.random()
    if 0.1 < damage < 0.2:
        row = rng.integers(len(rows) - 1)
        rows[row] = rows[row][:-3]
    lines = [separator.join(row) for row in (*heads, *[[""]] * int(rng.integers(2)), *rows)]
    text = "\ufeff" * int(rng.integers(2)) + "\n".join(lines) + "\n"
    if damage < 0.1:
        text = text.replace("houlder", "ound").replace("HOULDER", "OUND")
    return text, None if damage < 0.2 else poses, [*names]


def directions(poses, bones):
    """Return unit vectors (T, B, 3) of bones in a frame that the first hips and up define."""
    across = poses[0, JOINT_INDEX["hip_right"]] - poses[0, JOINT_INDEX["hip_left"]]
    turn = Rotation.from_euler("y", np.arctan2(across[2], across[0])).as_matrix()
    ways = np.stack([poses[:, JOINT_INDEX[joint]] - poses[:, JOINT_INDEX[parent]] for joint, parent in bones], axis=1)
    return (ways / np.linalg.norm(ways, axis=2, keepdims=True)) @ turn.T


def judge(path, seed):
    """Return "right", "refused" or what is wrong with how a random table is read."""
    content, expected, joints = table(seed)
    path.write_text(content, encoding="utf-8")
    try:
        [clip] = read_log(path)
    except SkeletonLogError as error:
        return "refused" if expected is None else f"refused: {error}"
    if expected is None:
        return "read although it is damaged"
    if len(clip.times) != len(expected) or not np.allclose(np.diff(clip.times), 1 / 30, atol=2e-3):
        return f"wrong times {clip.times[:9]}"
    bones = [bone for bone in PARENTS.items() if {*bone} <= {*joints} and "head" not in bone]
    found, true = directions(clip.positions, bones), directions(expected, bones)
    angle = np.degrees(np.arccos(np.clip((found * true).sum(axis=2), -1, 1)))
    if not angle.max() < 3:
        return f"{bones[int(np.argmax(np.nan_to_num(angle, nan=360).max(axis=0)))][0]} is wrong"
    size = bone_lengths(clip.positions[0])["elbow_left"] / bone_lengths(expected[0])["elbow_left"]
    return "right" if 0.99 < size < 1.01 else f"{size:.3f} times as large"
