"""Films as videos: frames are drawn, mixed with sound and written one by one."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from engine_bridge.character import own_targets
from engine_bridge.character.materials import Appearance, drawn_normals, materials_of
from engine_bridge.character.surfaces.surface import srgb_to_linear
from engine_bridge.film import overlays
from engine_bridge.film.actor import Actor
from engine_bridge.film.av_library import require_av
from engine_bridge.film.bubbles import Bubble, bubbles_of
from engine_bridge.film.drawing import WHOLE_FRAME, Canvas, ShownFrame, ShownPicture, ShownView, draw_in_order
from engine_bridge.film.framing import Extent, View
from engine_bridge.film.plan import FilmPlan
from engine_bridge.film.production import Production, Progress, measure
from engine_bridge.film.scene import Scene, SceneError, load
from engine_bridge.film.sound import SAMPLE_RATE, Mixer
from engine_bridge.film.video import FORMATS, VideoWriter
from engine_bridge.performance.channels import morph_weights
from engine_bridge.pictures.renderer import SAMPLES
from puppetline.errors import at
from puppetline.files import check_one_of, written_whole
from solver.model.binding import ShadedBinding
from solver.motion.deformer import to_file_units

GIF_WIDTH, GIF_FPS = 480, 15.0
"""Maximum width of a .gif in pixels, and its maximum number of frames per second."""

PALETTE_FRAMES = 8
"""Number of frames from which the colours of a .gif are chosen."""

ENDINGS = (*FORMATS, ".glb")


@dataclass(frozen=True)
class FilmSummary:
    """Result of a film.

    A .glb has no size and no sounds.
    """

    output: str
    frames: int
    seconds: float
    fps: float
    bytes: int
    notes: tuple[str, ...]
    width: int = 0
    height: int = 0
    sounds: int = 0


def check_output(output: Path, scene: Path) -> None:
    """Check that a film can be written.

    Raises
    ------
    OutputError
    """
    check_one_of(output, ENDINGS, f"one of {', '.join(ENDINGS)}", f"Call it {output.stem}.mp4.", inputs=(scene,))


def make_video(
    path: Path, output: Path, start: float, stop: float | None, draft: bool, progress: Progress
) -> FilmSummary:
    """Make a video of a scene file.

    Parameters
    ----------
    path, output : Path
    start, stop : float, float or None
        Part of the film, in seconds.
    draft : bool
        Whether to draw it with half the width, height and frame rate, and with rough edges.
    progress : callable

    Raises
    ------
    PuppetlineError
        Before anything is written.
    """
    check_output(output, path)
    scene = load(path)
    require_av()
    with ExitStack() as opened:
        ending = output.suffix.lower()
        size = _size(scene, draft, ending)
        for number, title in enumerate(scene.title, 1):
            overlays.title(title, size, at(path, field=f"[[title]] {number}"), path.parent)
        frames, canvas = _prepare(path, scene, size, 1 if draft else SAMPLES, progress)
        production = frames.production
        numbers = _numbers(production, start, stop, draft, ending)
        mixer = Mixer(production.sounds if FORMATS[ending].sound else (), path, production.seconds, scene.music)
        samples = [canvas.draw(frames[number]) for number in _samples(numbers, ending)]
        beside = opened.enter_context(written_whole(output))
        fps = production.fps / numbers.step
        writer = opened.enter_context(VideoWriter(beside, size, fps, sound=bool(mixer), samples=samples))
        mixer.skip(round(numbers.start / production.fps * SAMPLE_RATE))
        drawn = opened.enter_context(closing(draw_in_order((frames[number] for number in numbers), canvas)))
        _write(numbers, production.fps, drawn, mixer, writer, progress)
    notes = (*production.notes, *mixer.notes)
    if mixer.peak > 1:
        notes += (f"The sound is {20 * np.log10(mixer.peak):.1f} dB too loud and was cut off; lower the gains.",)
    return FilmSummary(
        output=str(output),
        frames=len(numbers),
        seconds=len(numbers) / fps,
        width=size[0],
        height=size[1],
        fps=fps,
        sounds=len(mixer),
        bytes=output.stat().st_size,
        notes=notes,
    )


def first_frame(path: Path, progress: Progress) -> NDArray[np.uint8]:
    """Return the first frame (h, w, 4) of a scene file; what is needed for it is ready if the film is made next.

    Raises
    ------
    PuppetlineError
    """
    scene = load(path)
    frames, canvas = _prepare(path, scene, scene.film.size, SAMPLES, progress)
    return canvas.draw(frames[0])


def _prepare(
    path: Path, scene: Scene, size: tuple[int, int], samples: int, progress: Progress
) -> tuple["_Frames", Canvas]:
    """Return what the frames of a scene file show, and a canvas that draws them."""
    bubbles = bubbles_of(scene, size, path)
    production, extents = measure(path, scene, progress)
    frames = _Frames(production, extents, bubbles, size)
    return frames, Canvas(scene, path, size, samples, frames.stage, frames.characters)


def _write(
    numbers: range,
    fps: float,
    drawn: Iterable[NDArray[np.uint8]],
    mixer: Mixer,
    writer: VideoWriter,
    progress: Progress,
) -> None:
    """Mix and write all frames; each is compressed while the next is drawn."""
    first_sample = round(numbers.start / fps * SAMPLE_RATE)
    written = 0
    with ThreadPoolExecutor(1) as other:
        added = other.submit(lambda: None)
        for count, (frame, pixels) in enumerate(zip(numbers, drawn, strict=True), 1):
            samples = round(min(frame + numbers.step, numbers.stop) / fps * SAMPLE_RATE) - first_sample
            sound = mixer.read(samples - written) if mixer else None
            added.result()
            added = other.submit(writer.add, pixels, sound)
            written = samples
            progress("Filming", count / len(numbers))
        added.result()


def _size(scene: Scene, draft: bool, ending: str) -> tuple[int, int]:
    """Return the width and height of the frames, which are even."""
    width, height = scene.film.size
    scale = 0.5 if draft else 1.0
    if ending == ".gif":
        scale = min(scale, GIF_WIDTH / width)
    return max(2 * round(scale * width / 2), 16), max(2 * round(scale * height / 2), 16)


def _numbers(production: Production, start: float, stop: float | None, draft: bool, ending: str) -> range:
    """Return the numbers of the frames that are shown.

    Raises
    ------
    SceneError
        There are none.
    """
    fps = production.fps
    first = round(start * fps)
    end = production.frames if stop is None else min(round(stop * fps), production.frames)
    if end <= first:
        raise SceneError(
            production.path,
            found=f"a film of {production.seconds:.2f} s",
            expected=f"a film that has frames from second {start:g} on" + (f" to second {stop:g}" if stop else ""),
            fix="Choose an earlier --start or a later --stop.",
        )
    step = 2 if draft else 1
    if ending == ".gif":
        step = max(step, int(np.ceil(fps / GIF_FPS)))
    return range(first, end, step)


def _samples(numbers: range, ending: str) -> list[int]:
    """Return the numbers of frames from all over a film from which the colours of a .gif are chosen."""
    if ending != ".gif":
        return []
    return np.linspace(numbers.start, numbers.stop - 1, PALETTE_FRAMES).astype(int).tolist()


class _Frames:
    """What the frames of a production show.

    Attributes
    ----------
    production : Production
    stage : StageExtent
        The space of all motion.
    characters : list of (parts, materials)
        What `Canvas` takes.
    """

    def __init__(
        self, production: Production, extents: Mapping[str, Extent], bubbles: Sequence[Bubble], size: tuple[int, int]
    ) -> None:
        self.production, self._bubbles, self._size = production, bubbles, size
        self._plan = FilmPlan(production, extents, bubbles, size)
        self.stage = production.stage(extents)
        self._surfaces = [_Surface(actor) for actor in production.actors]
        self.characters = [(actor.prepared.character.parts, _materials(actor)) for actor in production.actors]
        self._titles: dict[int, NDArray[np.uint8]] = {}

    def __getitem__(self, frame: int) -> ShownFrame:
        """Return what a frame shows."""
        titles, brightness = list(self._shown_titles(frame)), self._plan.brightness(frame)
        return ShownFrame(
            [surface.at(frame) for surface in self._surfaces],
            [
                ShownView(view.camera, view.share * brightness, [*self._shown_bubbles(frame, view), *titles])
                for view in self._plan.views(frame)
            ],
        )

    def _shown_bubbles(self, frame: int, view: View) -> Iterator[ShownPicture]:
        for number, opacity, place in self._plan.bubbles(frame, view):
            pixels, edges = self._bubbles[number].draw(place)
            yield pixels, opacity, edges

    def _shown_titles(self, frame: int) -> Iterator[ShownPicture]:
        scene, path = self.production.scene, self.production.path
        for number, (table, opacity) in enumerate(zip(scene.title, self._plan.titles(frame), strict=True)):
            if opacity > 0:
                if number not in self._titles:
                    where = at(path, field=f"[[title]] {number + 1}")
                    self._titles[number] = overlays.title(table, self._size, where, path.parent)
                yield self._titles[number], opacity, WHOLE_FRAME
            else:
                self._titles.pop(number, None)


class _Surface:
    """The surface of an actor."""

    def __init__(self, actor: Actor) -> None:
        character, prepared = actor.prepared.character, actor.prepared
        self._actor = actor
        self._binding = ShadedBinding(
            prepared.model, character.vertices, prepared.mesh.of_render, drawn_normals(character), character.triangles
        )
        self._rest = self._binding.rest
        names = {morph.target for morph in prepared.puppet.morph}
        self._targets = {name: own_targets.displacements(character, name) for name in names}

    def at(self, frame: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the positions and unit normals (n, 3) on the stage at a frame."""
        actor = self._actor
        pose = actor.pose(frame)
        controls = to_file_units(pose.R, actor.prepared.model)
        values = {name: np.array([value], np.float32) for name, value in (pose.channels or {}).items()}
        self._binding.rest = self._rest
        for name, (weight,) in morph_weights(actor.prepared.puppet, values).items():
            self._binding.rest = self._binding.rest + weight * self._targets[name]
        vertices, normals = self._binding.vertices_and_normals(controls)
        linear = actor.to_stage(frame).astype(np.float32)
        return vertices @ linear[:3] + linear[3], normals @ linear[:3] / np.float32(actor.footing.scale)


def _materials(actor: Actor) -> list[Appearance]:
    """Return the materials of an actor's parts, in its colour."""
    red, green, blue = srgb_to_linear(np.array(ImageColor.getrgb(actor.color or "white")[:3]) / 255).tolist()
    return [
        replace(each, color=each.color * (red, green, blue, 1.0)) for each in materials_of(actor.prepared.character)
    ]
