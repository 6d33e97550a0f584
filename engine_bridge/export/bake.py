"""A character with a morph basis for live motion, in a .glb that engines need no addon for.

The basis is fitted to recorded motion, or to synthetic motion: all performances of the examples, and an exercise
of the handles. The character's root is left out of it: live, it is a translation that comes with every frame.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.sources.demo import performances
from capture.timeline import Timeline, resample
from engine_bridge.export import morph_basis
from engine_bridge.export.animation import Keyframes, animate
from engine_bridge.export.live_basis import REACH, LiveBasis, add_basis
from engine_bridge.export.morph_basis import MorphBasis
from engine_bridge.performance.clip import Progress, load_timeline, resting_pose, solve
from engine_bridge.performance.exercise import exercise
from engine_bridge.performance.frame_store import FrameStore
from engine_bridge.performance.rig import Rig, load_rig
from engine_bridge.performance.settings import Settings
from puppetline.errors import PuppetError
from puppetline.files import check_writable
from solver.model.batch import FRAMES as CHUNK
from solver.model.batch import BatchBinding

TOLERANCE = 0.002
"""Largest error as a fraction of the diagonal where the user does not say: the poses at the end of a reach have it."""

SHOWN_SECONDS = 20.0
"""Seconds of the motion that are put into the file as an animation, to look at."""


@dataclass(frozen=True)
class BakeSummary:
    """What `bake` has to say about its result.

    `error` and `rms` are distances of vertices from where the solver puts them, the largest and the root mean square
    over all vertices and frames of the motion, as fractions of the diagonal.
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

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Motion:
    """What a basis is fitted to.

    Attributes
    ----------
    frames : FrameStore
        (F, 4m, 3) float32: control variables, model units.
    name : str
        Of its beginning, which is shown.
    times : (f,) float32
        Seconds, of the first frames.
    root : (f, 3) float32
        Translation in them, mesh file's coordinates.
    notes : tuple of str
        What the user should know about the logs.
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
    """Make a .glb of a puppet's character on whose morph targets live poses can be projected.

    Parameters
    ----------
    puppet, output : Path
    logs : sequence of Path
        Skeleton logs whose motion the basis is to reproduce; without any, made-up motion that covers the puppet.
    targets : int, optional
        A limit to their number, at least 2, whatever the error.
    tolerance : float, optional
        Largest error of a vertex over all of the motion, as a fraction of the diagonal; `TOLERANCE` if left out.
    progress : callable, optional

    Raises
    ------
    PuppetlineError
        Before anything is written.
    """
    check_writable(output, ".glb", inputs=(puppet, *logs))
    settings = Settings(tolerance=TOLERANCE if tolerance is None else tolerance, targets=targets)
    progress("Preparing the character", 0.0)
    rig = load_rig(puppet)
    check_writable(output, ".glb", inputs=(Path(rig.character.document.name),))
    progress("Preparing the character", 1.0)
    motion = (
        recorded_motion(rig, logs, settings, progress)
        if logs
        else synthetic_motion(rig, tuple(performances()), settings, progress)
    )
    basis = fit(rig, motion, settings, progress)
    if not len(basis.directions):
        raise PuppetError(
            puppet,
            found="no motion that takes the character farther than the tolerance",
            expected="joints that move its handles",
            fix="Let joints move the handles, or bake from recordings in which they move.",
        )
    write(rig, motion, basis, output)
    live = LiveBasis(basis.directions.astype(np.float32), REACH, rig.model)
    squares = [live.project(R).residual ** 2 for R in motion.frames]
    return BakeSummary(
        output=str(output),
        frames=len(motion.frames),
        targets=basis.unit_weights.count,
        error=basis.error / float(rig.model.diagonal),
        rms=float(np.sqrt(np.mean(squares))),
        tolerance=settings.allowed,
        bytes=output.stat().st_size,
        repairs=tuple(rig.mesh.repairs.describe()),
        notes=(*rig.character.document.notes, *motion.notes),
    )


def recorded_motion(rig: Rig, logs: Sequence[Path], settings: Settings, progress: Progress) -> Motion:
    """Play logs, one after another.

    Raises
    ------
    SkeletonLogError
    """

    def read() -> Iterator[tuple[str, Timeline, tuple[str, ...]]]:
        for log in logs:
            timeline, notes = load_timeline(log, settings)
            yield log.stem, timeline, tuple(f"{log.name}: {note}" for note in notes)

    return _play(rig, read(), len(logs), settings, progress)


def synthetic_motion(rig: Rig, names: Sequence[str], settings: Settings, progress: Progress) -> Motion:
    """Play some of the examples' performances, and then exercise the handles."""
    timelines = {name: resample(performances()[name](), settings.fps, settings.max_gap) for name in names}
    takes = [(name, timeline, ()) for name, timeline in timelines.items()]
    motion = _play(rig, takes, len(takes), settings, progress)
    rest = resting_pose(timelines[names[0]], settings)
    for solved in exercise(rig, rest, CHUNK):
        motion.frames.append(solved)
    return motion


def _play(
    rig: Rig,
    takes: Iterable[tuple[str, Timeline, tuple[str, ...]]],
    count: int,
    settings: Settings,
    progress: Progress,
) -> Motion:
    """Let the character perform takes: names, timelines and notes, of which there are so many."""
    frames = FrameStore(rig.model.rest_controls.shape)
    shown: list[tuple[str, NDArray[np.float64], NDArray[np.float32]]] = []
    notes: list[str] = []
    for number, (name, timeline, about) in enumerate(takes):
        roots = []
        for solved in solve(rig, timeline, settings, CHUNK):
            frames.append(solved.R)
            roots.append(solved.root)
        if not shown:
            seen = timeline.times <= SHOWN_SECONDS
            shown.append((name, timeline.times[seen], np.concatenate(roots)[seen]))
        notes += about
        progress("Performing", (number + 1) / count)
    name, times, root = shown[0]
    return Motion(frames, name, times.astype(np.float32), root, tuple(notes))


def fit(rig: Rig, motion: Motion, settings: Settings, progress: Progress) -> MorphBasis:
    """Fit a basis to motion, with weights that leave room for other motion."""
    return morph_basis.fit(
        rig.model,
        BatchBinding.of_solver_mesh(rig.model, rig.mesh),
        motion.frames,
        tolerance=settings.allowed,
        most=settings.targets,
        reach=REACH,
        progress=lambda share: progress("Fitting morph targets", share),
    )


def write(rig: Rig, motion: Motion, basis: MorphBasis, output: Path) -> None:
    """Write a character with a basis, and the beginning of the motion as an animation.

    Raises
    ------
    OutputError
    """
    root = None if rig.puppet.root is None else motion.root
    take = Keyframes(motion.name, motion.times, basis.weights[: len(motion.times)], root)
    displacements = morph_basis.displacements(rig.character, rig.mesh, rig.model, motion.frames, basis)
    document = animate(rig.character, take, displacements)
    add_basis(document, basis.directions, REACH, rig.model)
    document.save(output)
