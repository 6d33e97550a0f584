"""Baking of a character with a morph basis for live motion, as a .glb that engines show without an addon.

The basis is fitted to recorded motion, or to synthetic motion: all example motions, and an exercise
of the handles and bones. A character that turns with its performer is in it at any angle. It does not contain the
motion of the root, which is a separate translation in live frames.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from capture.sources.demo import performances
from capture.timeline import Timeline, resample
from engine_bridge.export import morph_basis
from engine_bridge.export.animation import Keyframes, animate
from engine_bridge.export.live_basis import REACH, LiveBasis, store_basis
from engine_bridge.export.morph_basis import MorphBasis
from engine_bridge.performance.clip import Progress, load_timeline, reference_pose, solve
from engine_bridge.performance.exercise import exercise
from engine_bridge.performance.frame_store import FrameStore
from engine_bridge.performance.prepared_character import PreparedCharacter, load_prepared
from engine_bridge.performance.settings import Settings
from puppetline.errors import PuppetError
from puppetline.files import check_writable
from solver.model.batch import MAX_BATCH_FRAMES as CHUNK
from solver.motion.limbs import TRUNK

DEFAULT_TOLERANCE = 0.002
"""Default tolerance as a fraction of the diagonal; the poses at the limits of the exercise have the largest errors."""

TURNS_DEGREES = (120.0, 240.0)
"""Turns of a character that span all turns about one axis, together with the one of 0 degrees."""

TURNED_STEP = 3
"""Every frame of this number is turned: the others move the surface along the same directions."""

SHOWN_SECONDS = 20.0
"""Maximum duration of the animation in the file, in seconds."""


@dataclass(frozen=True)
class BakeSummary:
    """Result of `bake`.

    `error` and `rms` are the maximum and the root mean square distance of vertices from the solver's positions, over
    all vertices and frames of the motion, as fractions of the diagonal.
    """

    output: str
    frames: int
    targets: int
    error: float
    rms: float
    tolerance: float
    bytes: int
    repairs: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class FittedMotion:
    """Motion to which a basis is fitted.

    Attributes
    ----------
    frames : FrameStore
        (F, 4m, 3) float32: control variables, model units.
    name : str
        Name of the animation in the file, which shows the first frames.
    times : (f,) float32
        Times of the first frames in seconds.
    root : (f, 3) float32
        Translation in the first frames, mesh file's coordinates.
    notes : tuple of str
        Sentences for the user about the recordings.
    """

    frames: FrameStore
    name: str
    times: NDArray[np.float32]
    root: NDArray[np.float32]
    notes: tuple[str, ...]


def bake(
    puppet: Path,
    output: Path,
    logs: Sequence[Path] = (),
    *,
    targets: int | None = None,
    tolerance: float | None = None,
    progress: Progress = lambda _stage, _share: None,
) -> BakeSummary:
    """Write a .glb of a puppet's character with morph targets on which live poses can be projected.

    Parameters
    ----------
    puppet, output : Path
    logs : sequence of Path
        Recordings with the motion for the basis; without any, synthetic motion that covers the puppet.
    targets : int, optional
        Maximum number of targets, at least 2, regardless of the error.
    tolerance : float, optional
        Maximum error of a vertex over all of the motion, as a fraction of the diagonal; `DEFAULT_TOLERANCE` by default.
    progress : callable, optional

    Raises
    ------
    PuppetlineError
        Before anything is written.
    """
    check_writable(output, ".glb", inputs=(puppet, *logs))
    settings = Settings(tolerance=DEFAULT_TOLERANCE if tolerance is None else tolerance, targets=targets)
    progress("Preparing the character", 0.0)
    prepared = load_prepared(puppet)
    check_writable(output, ".glb", inputs=(Path(prepared.character.document.name),))
    progress("Preparing the character", 1.0)
    motion = (
        recorded_motion(prepared, logs, settings, progress)
        if logs
        else synthetic_motion(prepared, tuple(performances()), settings, progress)
    )
    basis = fit(prepared, motion, settings, progress)
    if not len(basis.directions):
        raise PuppetError(
            puppet,
            found="motion within the tolerance only",
            expected="joints that move its handles",
            fix="Assign joints to the handles, or bake from recordings in which the joints move.",
        )
    write(prepared, motion, basis, output)
    live = LiveBasis(basis.directions.astype(np.float32), REACH, prepared.model)
    squares = [live.project(R).residual ** 2 for R in motion.frames]
    return BakeSummary(
        output=str(output),
        frames=len(motion.frames),
        targets=basis.unit_weights.count,
        error=basis.error / float(prepared.model.diagonal),
        rms=float(np.sqrt(np.mean(squares))),
        tolerance=settings.max_error,
        bytes=output.stat().st_size,
        repairs=tuple(prepared.mesh.repairs.describe()),
        notes=(*prepared.character.document.notes, *motion.notes),
    )


def recorded_motion(
    prepared: PreparedCharacter, logs: Sequence[Path], settings: Settings, progress: Progress
) -> FittedMotion:
    """Return the motion of some recordings.

    Raises
    ------
    SkeletonLogError
    """

    def read() -> Iterator[tuple[str, Timeline, tuple[str, ...]]]:
        for log in logs:
            timeline, notes = load_timeline(log, settings)
            yield log.stem, timeline, tuple(f"{log.name}: {note}" for note in notes)

    motion = _play(prepared, read(), len(logs), settings, progress)
    _add_turned(prepared, motion.frames)
    return motion


def synthetic_motion(
    prepared: PreparedCharacter, names: Sequence[str], settings: Settings, progress: Progress
) -> FittedMotion:
    """Return the motion by some of the example motions, followed by an exercise of the handles."""
    timelines = {name: resample(performances()[name](), settings.fps, settings.max_gap) for name in names}
    clips = [(name, timeline, ()) for name, timeline in timelines.items()]
    motion = _play(prepared, clips, len(clips), settings, progress)
    rest = reference_pose(prepared.puppet, timelines[names[0]], settings)
    for solved in exercise(prepared, rest, CHUNK):
        motion.frames.append(solved)
    _add_turned(prepared, motion.frames)
    return motion


def _add_turned(prepared: PreparedCharacter, frames: FrameStore) -> None:
    """Add frames in which the whole character has turned about its trunk's root, if it turns with its performer."""
    trunk = next((limb for limb in prepared.puppet.limbs if limb.name == TRUNK), None)
    if trunk is None or not prepared.puppet.turns:
        return
    middle = prepared.model.to_model(np.array(trunk.points[:1]))
    axis = np.radians(TURNS_DEGREES)[:, None] * prepared.puppet.character.basis[1]
    for start in range(0, len(frames), CHUNK):
        some = frames[start : start + CHUNK : TURNED_STEP].astype(np.float64)
        for turn in scipy.spatial.transform.Rotation.from_rotvec(axis).as_matrix():
            moved = (some @ turn.T).reshape(len(some), -1, 4, 3)
            moved[:, :, 3] += middle - middle @ turn.T
            frames.append(moved.reshape(some.shape))


def _play(
    prepared: PreparedCharacter,
    clips: Iterable[tuple[str, Timeline, tuple[str, ...]]],
    count: int,
    settings: Settings,
    progress: Progress,
) -> FittedMotion:
    """Return the motion of `count` clips, each a name, a timeline and notes."""
    frames = FrameStore(prepared.model.rest_controls.shape)
    shown: list[tuple[str, NDArray[np.float64], NDArray[np.float32]]] = []
    notes: list[str] = []
    for number, (name, timeline, about) in enumerate(clips):
        solved = solve(prepared, timeline, settings)
        for start in range(0, len(solved), CHUNK):
            frames.append(solved.R[start : start + CHUNK])
        if not shown:
            seen = solved.times <= SHOWN_SECONDS
            shown.append((name, solved.times[seen], solved.root[:][seen]))
        notes += about
        progress("Performing", (number + 1) / count)
    name, times, root = shown[0]
    return FittedMotion(frames, name, times.astype(np.float32), root, tuple(notes))


def fit(prepared: PreparedCharacter, motion: FittedMotion, settings: Settings, progress: Progress) -> MorphBasis:
    """Fit a basis to motion, with weights that leave room for larger motion."""
    return morph_basis.fit_rig(prepared, motion.frames, settings, progress, REACH)


def write(prepared: PreparedCharacter, motion: FittedMotion, basis: MorphBasis, output: Path) -> None:
    """Write a character with a basis, and an animation of the start of the motion.

    Raises
    ------
    OutputError
    """
    root = None if prepared.puppet.root is None else motion.root
    keyframes = Keyframes(motion.name, motion.times, basis.weights[: len(motion.times)], root)
    displacements = morph_basis.displacements(prepared.character, prepared.mesh, prepared.model, motion.frames, basis)
    document = animate(prepared.character, keyframes, displacements)
    store_basis(document, basis.directions, REACH, prepared.model)
    document.save(output)
