"""Films as videos: frames are drawn, mixed with sound and written one by one."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from engine_bridge.character import own_targets
from engine_bridge.character.materials import drawn_normals, materials_of
from engine_bridge.character.surfaces.surface import srgb_to_linear
from engine_bridge.film import overlays
from engine_bridge.film.actor import Actor
from engine_bridge.film.av_library import require_av
from engine_bridge.film.bubbles import Bubble, bubbles_of
from engine_bridge.film.framing import View
from engine_bridge.film.moods import lighting_of
from engine_bridge.film.painting import BOTTOM, PERIOD, TOP
from engine_bridge.film.plan import FilmPlan
from engine_bridge.film.production import Production, Progress, produce
from engine_bridge.film.scene import DEFAULT_SET, Scene, SceneError, load
from engine_bridge.film.sets import SETS, panorama
from engine_bridge.film.sound import SAMPLE_RATE, Mixer
from engine_bridge.film.video import FORMATS, VideoWriter
from engine_bridge.performance.channels import morph_weights
from engine_bridge.pictures.gpu_renderer import SAMPLES, Drawn, GpuRenderer
from engine_bridge.pictures.gpu_scene import Overlay, Panorama, Surroundings
from puppetline.errors import at
from puppetline.files import check_one_of, written_whole
from solver.model.binding import ShadedBinding
from solver.motion.deformer import to_file_units

if TYPE_CHECKING:
    import moderngl

GIF_WIDTH, GIF_FPS = 480, 15.0
"""Maximum width of a .gif in pixels, and its maximum number of frames per second."""

PALETTE_FRAMES = 8
"""Number of frames from which the colours of a .gif are chosen."""

ENDINGS = (*FORMATS, ".glb")


@dataclass(frozen=True)
class FilmSummary:
    """Result of a film.

    `device` is what drew the frames. A .glb has no device, size and sounds.
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
    device: str = ""


class Part(NamedTuple):
    """The frames of a film that are shown: every n-th of a range."""

    first: int
    end: int
    step: int


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
        samples = 1 if draft else SAMPLES
        size = _size(scene, draft, ending)
        renderer = opened.enter_context(GpuRenderer(size, samples))
        for number, title in enumerate(scene.title, 1):
            overlays.title(title, size, at(path, field=f"[[title]] {number}"), path.parent)
        bubbles = bubbles_of(scene, size, path)
        around = surroundings(scene, renderer, path)
        production = produce(path, scene, progress)
        part = _part(production, start, stop, draft, ending)
        mixer = Mixer(production.sounds if FORMATS[ending].sound else (), path, production.seconds, scene.music)
        view = _View(production, renderer, around, bubbles, progress)
        beside = opened.enter_context(written_whole(output))
        writer = opened.enter_context(
            VideoWriter(beside, size, production.fps / part.step, sound=bool(mixer), samples=view.samples(part, ending))
        )
        mixer.skip(round(part.first / production.fps * SAMPLE_RATE))
        _write(part, production.fps, view, mixer, writer, progress)
    notes = (*production.notes, *mixer.notes)
    if mixer.peak > 1:
        notes += (f"The sound is {20 * np.log10(mixer.peak):.1f} dB too loud and was cut off; lower the gains.",)
    frames = len(range(part.first, part.end, part.step))
    return FilmSummary(
        output=str(output),
        frames=frames,
        seconds=frames * part.step / production.fps,
        width=size[0],
        height=size[1],
        fps=production.fps / part.step,
        sounds=len(mixer),
        device=view.device,
        bytes=output.stat().st_size,
        notes=notes,
    )


def _write(part: Part, fps: float, view: "_View", mixer: Mixer, writer: VideoWriter, progress: Progress) -> None:
    """Draw, mix and write all frames; each is compressed while the next is drawn."""
    first_sample = round(part.first / fps * SAMPLE_RATE)
    written = 0
    numbers = range(part.first, part.end, part.step)
    with ThreadPoolExecutor(1) as other:
        added = other.submit(lambda: None)
        for count, frame in enumerate(numbers, 1):
            samples = round(min(frame + part.step, part.end) / fps * SAMPLE_RATE) - first_sample
            pixels, sound = view.draw(frame), mixer.read(samples - written) if mixer else None
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


def _part(production: Production, start: float, stop: float | None, draft: bool, ending: str) -> Part:
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
    return Part(first, end, step)


def surroundings(scene: Scene, renderer: GpuRenderer, path: Path) -> Surroundings:
    """Return the background, the floor and the light of a scene file.

    Raises
    ------
    SceneError
        The picture cannot be opened.
    """
    chosen, color = scene.background.shown_set, scene.floor.color
    painted = SETS[chosen or DEFAULT_SET]
    background: moderngl.Texture | Panorama
    if chosen is None:
        background = renderer.picture(overlays.background(scene.background, renderer.size, path))
    else:
        background = Panorama(renderer.tile(panorama(chosen)), PERIOD, TOP, BOTTOM)
    floor = None if scene.background.picture else painted.floor()
    if color is not None:
        floor = np.full((1, 1, 4), (*ImageColor.getrgb(color)[:3], 255), np.uint8)
    tile = None if floor is None else renderer.tile(floor)
    return Surroundings(background, tile, scene.floor.show, lighting_of(scene))


class _View:
    """Draws frames of a production."""

    def __init__(
        self,
        production: Production,
        renderer: GpuRenderer,
        around: Surroundings,
        bubbles: Sequence[Bubble],
        progress: Progress,
    ) -> None:
        self._production, self._renderer, self._around, self._bubbles = production, renderer, around, bubbles
        self.device = renderer.device
        extents = production.extents(progress)
        self._plan = FilmPlan(production, extents, bubbles, renderer.size)
        self._stage = production.stage(extents)
        self._puppets = [_DrawnActor(actor, renderer) for actor in production.actors]
        self._titles: dict[int, moderngl.Texture] = {}

    def draw(self, frame: int) -> NDArray[np.uint8]:
        """Return the pixels (h, w, 4) of a frame."""
        for each in self._puppets:
            each.move(frame)
        titles, drawn = list(self._shown_titles(frame)), [each.drawn for each in self._puppets]
        views, brightness = self._plan.views(frame), self._plan.brightness(frame)
        pictures = []
        for view in views:
            bubbles = list(self._shown_bubbles(frame, view))
            pictures.append(self._renderer.draw(view.camera, self._stage, drawn, self._around, [*bubbles, *titles]))
            for bubble in bubbles:
                bubble.picture.release()
        if len(views) == 1 and brightness == 1:
            return pictures[0]
        mixed = sum(np.float32(view.share * brightness) * each for each, view in zip(pictures, views, strict=True))
        return np.rint(mixed).astype(np.uint8)

    def samples(self, part: Part, ending: str) -> list[NDArray[np.uint8]]:
        """Return frames from all over a part, from which the colours of a .gif are chosen."""
        if ending != ".gif":
            return []
        return [
            self.draw(frame) for frame in np.linspace(part.first, part.end - 1, PALETTE_FRAMES).astype(int).tolist()
        ]

    def _shown_bubbles(self, frame: int, view: View) -> Iterator[Overlay]:
        for number, opacity, place in self._plan.bubbles(frame, view):
            pixels, edges = self._bubbles[number].draw(place)
            yield Overlay(self._renderer.picture(pixels), opacity, edges)

    def _shown_titles(self, frame: int) -> Iterator[Overlay]:
        scene, path = self._production.scene, self._production.path
        for number, (table, opacity) in enumerate(zip(scene.title, self._plan.titles(frame), strict=True)):
            if opacity > 0:
                if number not in self._titles:
                    where = at(path, field=f"[[title]] {number + 1}")
                    pixels = overlays.title(table, self._renderer.size, where, path.parent)
                    self._titles[number] = self._renderer.picture(pixels)
                yield Overlay(self._titles[number], opacity)
            elif number in self._titles:
                self._titles.pop(number).release()


class _DrawnActor:
    """An actor on the graphics card."""

    def __init__(self, actor: Actor, renderer: GpuRenderer) -> None:
        character, rig = actor.rig.character, actor.rig
        self._actor = actor
        self._binding = ShadedBinding(
            rig.model, character.vertices, rig.mesh.of_render, drawn_normals(character), character.triangles
        )
        self._rest = self._binding.rest
        names = {morph.target for morph in rig.puppet.morph}
        self._targets = {name: own_targets.displacements(character, name) for name in names}
        tint = np.array([*linear_color(actor.color or "white"), 1.0])
        materials = [replace(each, color=each.color * tint) for each in materials_of(character)]
        self.drawn: Drawn = renderer.add(character.parts, materials)

    def move(self, frame: int) -> None:
        """Show its pose at a frame."""
        actor = self._actor
        pose = actor.pose(frame)
        controls = to_file_units(pose.R, actor.rig.model)
        values = {name: np.array([value], np.float32) for name, value in (pose.channels or {}).items()}
        self._binding.rest = self._rest
        for name, (weight,) in morph_weights(actor.rig.puppet, values).items():
            self._binding.rest = self._binding.rest + weight * self._targets[name]
        vertices, normals = self._binding.vertices_and_normals(controls)
        linear = actor.to_stage(frame).astype(np.float32)
        self.drawn.move(vertices @ linear[:3] + linear[3], normals @ linear[:3] / np.float32(actor.footing.scale))


def linear_color(color: str) -> tuple[float, float, float]:
    """Return the linear RGB of a colour by its name or number."""
    red, green, blue = srgb_to_linear(np.array(ImageColor.getrgb(color)[:3]) / 255).tolist()
    return red, green, blue
