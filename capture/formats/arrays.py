"""Joint positions, or parameters of the SMPL body, in NumPy's and MATLAB's files of arrays.

Positions have the axes frames, joints and x y z in any order, perhaps people, and perhaps a confidence after z.
`capture.formats.joint_sets` finds the order of the joints, `capture.formats.smpl` the joints of a body's parameters.
"""

import itertools
import zipfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.formats import landmarks_json, smpl
from capture.formats._columns import of_angles
from capture.formats._files import opened
from capture.formats._mat5 import Mat5Error, Variable, variables
from capture.formats.clips import with_stated_rate
from capture.formats.joint_order import COUNTS, names_by_shape
from capture.formats.joint_sets import Fit, as_of, clearest, fits
from capture.formats.layouts import JOINT_SETS
from capture.formats.options import ReadOptions
from capture.formats.positions import WHOLE_BODY, clip_of_positions, is_person, part_of_a_person
from capture.formats.proportions import refuse_flat
from capture.formats.skeleton_joints import BY_SHAPE_NOTE
from capture.formats.table import confidence_of
from puppetline.errors import SkeletonLogError

Arrays = Mapping[str, NDArray[np.generic]]

MAX_BYTES = 2**30
"""Maximum size of all arrays of a file."""

MAX_ARRAYS = 1000
"""Maximum number of arrays of a file that are read."""

MAX_PEOPLE = 16
"""Maximum number of people in one array; there are at least as many frames."""

HUMANML3D_FEATURES, HUMANML3D_FPS = 263, 20.0
"""Number of features of a frame, and of frames per second, in HumanML3D."""

WITH_ROTATIONS = (6, 7)
"""Numbers of a joint that has angles or a quaternion after x y z."""

NPY_MAGIC = b"\x93NUMPY"

_SIZES = {len(joints) for joints in JOINT_SETS.values()}


def matches(head: bytes) -> bool:
    """Return whether a file's head is that of an .npy, .npz or MATLAB 5 file."""
    is_archive = head.startswith(b"PK\3\4") and head[30 : 30 + int.from_bytes(head[26:28], "little")].endswith(b".npy")
    is_matlab = head.startswith(b"MATLAB 5.0 MAT-file") and head[126:128] in (b"IM", b"MI")
    return head.startswith(NPY_MAGIC) or is_archive or is_matlab


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read one clip per performer; the rate is that of `options`, of the file, or 30 frames per second.

    Raises
    ------
    SkeletonLogError
        The file is damaged, or its arrays are no person's joints or parameters.
    """
    try:
        return _of_arrays(path, load(path), options)
    except SkeletonLogError:
        if clips := _of_structures(path, options):
            return clips
        raise


def _of_structures(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Return the clips of a MATLAB file whose structures and cells have the poses of frames; none of other files."""
    try:
        with opened(path) as file:
            found = variables(file.read())
        document = {name: each.document() for name, each in found.items() if each.kind != "numbers"}
    except Mat5Error:
        return []
    return landmarks_json.clips_of(path, "arrays", document, options)


def _of_arrays(path: Path, arrays: Arrays, options: ReadOptions) -> list[SkeletonClip]:
    single = {place: array for place, array in arrays.items() if array.size == 1 and array.dtype.kind in "fiu"}
    values = [(place.rsplit(".", 1)[-1], float(array.item())) for place, array in single.items()]
    options, notes = with_stated_rate(options, values)
    arrays = {**arrays, **_joined(arrays)}
    if parameters := smpl.parameters(arrays) or smpl.in_rows(arrays.get("", np.empty(0))):
        return [smpl.clip_of(path, "arrays", parameters, options, notes)]
    for own_names, points in _named(arrays):
        return [clip_of_positions(path, "arrays", own_names, points, options, notes=notes)]
    if fits(joints := _of_features(arrays), ["smpl_22"]):
        options = replace(options, fps=options.fps or HUMANML3D_FPS)
        notes = (*notes, f"Features of HumanML3D, which has {HUMANML3D_FPS:g} frames per second.")
        arrays = {"": joints}
    names, people = _people(path, arrays, options)
    notes = notes if all(names) else (*notes, BY_SHAPE_NOTE)
    return [
        replace(
            clip_of_positions(
                path,
                "arrays",
                names,
                person[..., :3],
                options,
                confidence=confidence_of(person[..., 3]) if person.shape[2] > 3 else None,
                notes=notes,
            ),
            user=user,
        )
        for user, person in enumerate(people)
        if np.isfinite(person).any() and person[..., :3].any()
    ]


def load(path: Path) -> Arrays:
    """Return the arrays of numbers in a file by name, "" for that of an .npy file.

    Raises
    ------
    SkeletonLogError
        The file is damaged, too large, or has Python objects.
    """
    with opened(path) as file:
        start = file.read(len(NPY_MAGIC))
    try:
        if start == NPY_MAGIC:
            return {"": np.load(path, allow_pickle=False, mmap_mode="r")}
        if start.startswith(b"PK"):
            with zipfile.ZipFile(path) as archive:
                if sum(member.file_size for member in archive.infolist()) > MAX_BYTES:
                    raise ValueError("more than 1 GiB")
            with np.load(path, allow_pickle=False) as loaded:
                arrays = {name: each for name in loaded.files if (each := _numeric(loaded, name)) is not None}
                return arrays or {name: loaded[name] for name in loaded.files}
        with opened(path) as file:
            found = variables(file.read())
        arrays = dict(itertools.islice(_of_matlab(found), MAX_ARRAYS))
        if not any(array.dtype.kind == "f" for array in arrays.values()):
            _refuse_variables(path, found)
        return arrays
    except SkeletonLogError:
        raise
    except Exception as error:  # NumPy raises errors of any kind for a damaged file
        is_object = any(words in str(error) for words in ("allow_pickle", "Python objects"))
        raise SkeletonLogError(
            path,
            found="a NumPy array of Python objects, which can run any program when it is read"
            if is_object
            else f"a file of arrays that cannot be read ({error})",
            expected="arrays of numbers",
            fix="In Python, save the joints as numbers: np.save(…, np.asarray(joints, dtype=np.float32))."
            if is_object
            else "Save it again from where it was written; MATLAB: save -v7.",
        ) from error


def _of_matlab(
    found: Mapping[str, Variable], prefix: str = "", depth: int = 4
) -> Iterator[tuple[str, NDArray[np.generic]]]:
    """Yield arrays of numbers, and lists of texts, by their places in structures and cells, such as take.data."""
    for name, each in found.items():
        if each.kind == "numbers":
            yield prefix + name, each.numbers()
        elif depth and (parts := each.parts()):
            if all(part.kind == "text" for part in parts.values()):
                yield prefix + name, np.array([part.text() for part in parts.values()])
            else:
                yield from _of_matlab(parts, f"{prefix}{name}.", depth - 1)


def _refuse_variables(path: Path, found: Mapping[str, Variable]) -> NoReturn:
    listed = "; ".join(f"{name} ({each.description()})" for name, each in list(found.items())[:4])
    raise SkeletonLogError(
        path,
        found=f"MATLAB variables without arrays of numbers: {listed}{'; …' if len(found) > 4 else ''}",
        expected="an array of a person's joints, frames × joints × 3",
        fix="In MATLAB, save the positions themselves: joints = take.data; save('joints.mat', 'joints', '-v7').",
    )


def _numeric(loaded: "np.lib.npyio.NpzFile", name: str) -> NDArray[np.generic] | None:
    try:
        array = loaded[name]
    except ValueError:  # an array of Python objects beside others
        return None
    return array if isinstance(array, np.ndarray) and array.dtype.kind in "fiubU" else None


def _named(arrays: Arrays) -> Iterator[tuple[list[str], NDArray[np.float64]]]:
    """Yield names and positions (T, J, 3) of arrays that are called like joints, or beside a list of their names."""
    groups: dict[tuple[str, int], dict[str, NDArray[np.float64]]] = {}
    for place, array in arrays.items():
        *group, name = place.rsplit(".", 1)
        if array.dtype.kind in "fiu" and array.ndim == 2 and 3 in array.shape:
            rows = (array if array.shape[1] == 3 else array.T).astype(np.float64)
            groups.setdefault(("".join(group), len(rows)), {})[name] = rows
        if array.dtype.kind == "U" and is_person(names := [str(each) for each in array.ravel()]):
            beside = [each for other, each in arrays.items() if other.rsplit(".", 1)[:-1] == group]
            for each in beside:
                if each.dtype.kind in "fiu" and each.size <= MAX_BYTES // 8:
                    yield from ((names, people[0][..., :3]) for people in _orders(each, {len(names)}))
    for joints in groups.values():
        if is_person(list(joints)):
            yield list(joints), np.stack(list(joints.values()), axis=1)


def _of_features(arrays: Arrays) -> NDArray[np.float64]:
    """Return the joints (T, 22, 3) that HumanML3D's features (T, 263) tell; no frame of other arrays.

    The features are the turn and motion of the root since the frame before, its height, and the joints relative to it
    (Guo et al. 2022); rotations and velocities, which say the same again, follow.
    """
    for array in map(np.squeeze, arrays.values()):
        if array.ndim == 2 and array.shape[1] == HUMANML3D_FEATURES and array.dtype.kind == "f":
            features = array.astype(np.float64)
            before = np.vstack([np.zeros((1, 3)), features[:-1, :3]])
            turn = Rotation.from_rotvec(np.outer(-2 * np.cumsum(before[:, 0]), [0.0, 1.0, 0.0]))
            root = np.cumsum(turn.apply(np.insert(before[:, 1:], 1, 0, axis=1)), axis=0)
            offsets = features[:, 4:67].reshape(-1, 21, 3)
            joints = np.einsum("tij,tkj->tki", turn.as_matrix(), offsets) + root[:, None]
            root[:, 1] = features[:, 3]
            return np.concatenate([root[:, None], joints], axis=1)
    return np.empty((0, 22, 3))


def _people(path: Path, arrays: Arrays, options: ReadOptions) -> tuple[Sequence[str], list[NDArray[np.float64]]]:
    """Return the names of the joints of the array that is a person's, "" for others, and its people (T, J, 3 or 4)."""
    found: list[tuple[Fit, list[NDArray[np.float64]]]] = []
    for array in _of_points(arrays):
        for people in _orders(array):
            sets = [
                name
                for name, joints in JOINT_SETS.items()
                if len(joints) == people[0].shape[1] and options.joints in (None, name)
            ]
            known = max(people, key=lambda person: np.count_nonzero(np.nan_to_num(person)))
            found += [(fit, people) for fit in fits(known[..., :3], sets)]
    for array in () if found or options.joints else _of_points(arrays):
        for people in _orders(array, COUNTS) if array.ndim == 3 else ():
            if is_person(names := names_by_shape(people[0][..., :3])):
                return names, people
    if not found:
        _refuse(path, arrays, options)
    best = clearest(path, [fit for fit, _ in found], describe(arrays))
    return next((JOINT_SETS[fit.name], people) for fit, people in found if fit is best)


def _joined(arrays: Arrays) -> Arrays:
    """Return arrays (…, 3) of which a file has x, y and z apart, under names that end so."""
    joined = {}
    for place, array in arrays.items():
        axes = [arrays.get(place[:-1] + chr(ord(place[-1]) + k)) for k in range(3)] if place[-1:] in ("x", "X") else []
        own = [np.squeeze(each) for each in axes if each is not None and each.shape == array.shape]
        if len(own) == 3 and own[0].ndim in (1, 2):
            joined[place[:-1].rstrip("._ ")] = np.stack(own, axis=-1)
    return joined


def _of_points(arrays: Arrays) -> Iterator[NDArray[np.generic]]:
    """Yield arrays that may be positions: a file's, without rotations after them, origins of matrices, or samples."""
    for array in arrays.values():
        if array.dtype.kind not in "fiu" or array.size > MAX_BYTES // 8:
            continue
        if array.ndim > 3 and array.shape[-2:] == (4, 4):
            is_by_rows = not array.reshape(-1, 4, 4)[:1, 3, :3].any()
            yield array[..., :3, 3] if is_by_rows else array[..., 3, :3]
        elif array.ndim > 2 and array.shape[-1] in WITH_ROTATIONS and 3 not in array.shape[:-1]:
            yield array[..., :3]
        elif array.ndim == 5 and array.shape[1] == 3 != array.shape[-1]:  # samples of people (N, 3, T, J, people)
            yield np.moveaxis(array, 0, -1).reshape(*array.shape[1:-1], -1)[..., :MAX_PEOPLE]
        else:
            yield array


def _orders(array: NDArray[np.generic], sizes: Collection[int] = _SIZES) -> list[list[NDArray[np.float64]]]:
    """Return the ways to read an array as people (T, J, 3 or 4)."""
    array = np.squeeze(array)
    if not array.size:
        return []
    if array.ndim == 1:  # one frame
        array = array[None]
    if array.ndim == 2:  # a row per frame, or per joint
        found = []
        for rows in (array, array.T):
            for size, width in itertools.product(sorted(sizes), (3, 4)):
                if rows.shape[1] == size * width:
                    whole = rows.astype(np.float64)
                    found.append([whole.reshape(len(rows), size, width)])
                    found.append([whole.reshape(len(rows), width, size).transpose(0, 2, 1)])
        return found
    if array.ndim not in (3, 4):
        return []
    found = []
    for axes in itertools.permutations(range(array.ndim)):
        *people, time, joint, place = axes
        counts = [array.shape[axis] for axis in axes]
        if counts[-1] not in (3, 4) or counts[-2] not in sizes or (people and counts[0] > min(MAX_PEOPLE, counts[1])):
            continue
        own = array.transpose(*people, time, joint, place).astype(np.float64)
        found.append(list(own) if people else [own])
    return found


def describe(arrays: Arrays) -> str:
    """Return what a file of arrays has, for messages."""
    listed = [f"{name} {array.shape}".strip() for name, array in list(arrays.items())[:8]]
    kind = "a NumPy array of" if list(arrays) == [""] else "arrays:"
    return f"{kind} {', '.join(listed)}{' …' if len(arrays) > 8 else ''}"


def _refuse(path: Path, arrays: Arrays, options: ReadOptions) -> NoReturn:
    shapes = [np.squeeze(array).shape for array in arrays.values()]
    for array, shape in zip(arrays.values(), shapes, strict=True):
        if len(shape) == 3 and shape[-1] == 3 and array.dtype.kind in "fiu" and array.size <= MAX_BYTES // 8:
            refuse_flat(path, np.squeeze(array).astype(np.float64))
    counts = [shape[-2] for shape in shapes if len(shape) > 2 and shape[-1] == 3]
    kind = next(filter(None, map(as_of, counts)), "") or of_angles(list(arrays))
    part = "" if kind else part_of_a_person([name.rsplit(".")[-1] for name in arrays])
    found, fix = f"{describe(arrays)}{kind}{part}", WHOLE_BODY if part else ""
    if any(shape[-1:] == (2,) and shape[-2:-1] and shape[-2] in _SIZES for shape in shapes):
        found, fix = f"{found}, positions in an image (2D)", "Use positions in space, or the video itself."
    elif any(shape[-1:] == (HUMANML3D_FEATURES,) for shape in shapes):
        found, fix = f"{found}, features of HumanML3D", "Use them as they are without normalisation, or the joints."
    elif options.joints:
        fix = f"The order {options.joints} gives no person; choose another one with --joints."
    raise SkeletonLogError(
        path,
        found=found,
        expected="joints of a person, frames × joints × 3, or parameters of SMPL (poses, trans)",
        fix=fix or "Save the joints in the order of a tracker or data set, and name the order with --joints.",
    )
