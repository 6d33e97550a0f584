"""Random tables of a person's joints, and whether a reader reads them right."""

import numpy as np
from scipy.spatial.transform import Rotation

from capture.body import bone_lengths
from capture.formats import read_log
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.errors import SkeletonLogError

from .people import person

V2 = {"hip_center": "spine_base", "spine": "spine_mid", "shoulder_center": "spine_shoulder"}
TRACKED = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
OPTIONAL = ("hand_left", "foot_right", "ankle_left", "knee_right", "spine", "head")

CLOCKS = [("time", 1 / 30, 4), ("Timestamp (ms)", 1000 / 30, 0), ("ticks", 1e7 / 30, 0), ("frame", 1, 0)]
"""Names of columns, steps between frames, and decimals."""


def side_first(joint):
    return "_".join(joint.split("_")[::-1]) if joint.endswith(("left", "right")) else joint


def names_of(rng):
    """Return the words for the joints that a table has."""
    tracked = [joint for joint in JOINTS if joint.split("_")[0] in TRACKED and joint not in V2]
    names = [
        {joint: joint for joint in JOINTS},
        {joint: V2.get(joint, joint) for joint in JOINTS},
        {joint: side_first(joint) for joint in tracked} | {"head": "nose"},
        {joint: side_first(joint) for joint in JOINTS},
    ][rng.integers(4)]
    if rng.random() < 0.3:
        names.pop(str(rng.choice([joint for joint in OPTIONAL if joint in names])))
    joints = list(names)
    rng.shuffle(joints)
    return {joint: names[joint] for joint in joints}


def spelled(style, word, axis):
    """Return a column's name in one of the ways in which programs write it."""
    camel = "".join(part.title() for part in word.split("_"))
    return (
        f"{word}_{axis}",
        f"{word}.{axis}",
        f"{camel}{axis.upper()}",
        f"{camel} Position {axis.upper()}",
        f"{axis.upper()}_{word}",
        f"{word}.position.{axis}",
        f"{word.upper()} ({axis})",
    )[style]


def moved(rng, poses, unit):
    """Return poses in other axes and another unit."""
    turn = Rotation.from_euler("y", rng.uniform(-180, 180), degrees=True).as_matrix()
    axes = [(0, 1, 2), (2, 0, 1), (0, 2, 1)][rng.integers(3)]
    return unit * ((poses @ turn.T)[..., axes] * rng.choice([-1.0, 1.0], 3) + rng.normal(size=3) * rng.integers(0, 2))


def long(names, moments, points):
    """Return header and rows of a table with a row per joint; `points` (T, J, 3) are texts."""
    rows = [
        [at, name, *point]
        for at, frame in zip(moments, points, strict=True)
        for name, point in zip(names, frame, strict=True)
    ]
    return [["joint", "x", "y", "z"]], rows


def cells(names, moments, points, brackets):
    """Return header and rows of a table with three numbers in a cell."""
    rows = [
        [at, *(brackets[0] + " ".join(point) + brackets[1] for point in frame)]
        for at, frame in zip(moments, points, strict=True)
    ]
    return [list(names)], rows


def wide(names, moments, points, style, order):
    """Return header and rows of a table with a number in a cell; style 7 has two header rows."""
    rows = [[at, *frame.ravel()[order]] for at, frame in zip(moments, points, strict=True)]
    if style == 7:
        return [[cell for name in names for cell in (name, "", "")], list("XYZ") * len(names)], rows
    heads = [spelled(style, name, axis) for name in names for axis in "xyz"]
    return [[heads[index] for index in order]], rows


def damaged(rng, heads, rows):
    """Spoil some tables; return whether."""
    kind, row = rng.random(), int(rng.integers(len(rows) - 1))
    if kind < 0.1:
        text = [
            [cell.replace("houlder", "ound").replace("HOULDER", "OUND") for cell in cells] for cells in heads + rows
        ]
        is_changed = text != heads + rows
        heads[:], rows[:] = text[: len(heads)], text[len(heads) :]
        return is_changed
    if kind < 0.2:
        rows[row] = rows[row][:-3]
    return kind < 0.2


def table(seed):
    """Return the text of a random table, the positions (T, 20, 3) in it, None if it is damaged, and its joints."""
    rng = np.random.default_rng(seed)
    poses = person(int(rng.integers(4, 12))) * rng.uniform(0.75, 1.12)
    names, unit = names_of(rng), float(rng.choice([1.0, 100.0, 1000.0]))
    title, step, decimals = CLOCKS[rng.integers(4)]
    separator, comma = str(rng.choice([",", ";", "\t", " "])), rng.random() < 0.3
    style, form = int(rng.integers(8)), str(rng.choice(["wide", "wide", "wide", "cells", "long"]))
    if separator == " " and (form == "cells" or style in (3, 6, 7)):
        separator = ";"
    mark = "," if comma and separator != "," and form != "cells" else "."
    own = moved(rng, poses, unit)[:, [JOINT_INDEX[joint] for joint in names]]
    points = np.vectorize(lambda value: f"{value:.{6 if unit == 1 else 3}f}".replace(".", mark), otypes=[object])(own)
    moments = [f"{(9 + index) * step:.{decimals}f}".replace(".", mark) for index in range(len(poses))]
    if form == "long":
        heads, rows = long(names.values(), moments, points)
    elif form == "cells":
        heads, rows = cells(names.values(), moments, points, [("", ""), ("[", "]"), ("(", ")")][rng.integers(3)])
    else:
        count = 3 * len(names)
        order = rng.permutation(count) if style < 7 and rng.random() < 0.5 else np.arange(count)
        heads, rows = wide(list(names.values()), moments, points, style, order)
    heads = [[title if level == 0 else "", *head] for level, head in enumerate(heads)]
    if separator == " ":
        heads = [[cell.replace(" ", "_") for cell in head] for head in heads]
    expected = None if damaged(rng, heads, rows) else poses
    lines = [separator.join(row) for row in (*heads, *[[""]] * int(rng.integers(2)), *rows)]
    return "\ufeff" * int(rng.integers(2)) + "\n".join(lines) + "\n", expected, list(names)


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
