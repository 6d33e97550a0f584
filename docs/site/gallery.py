"""Make the gallery: a short looping video, a .glb and a page with a player for each character, and a page of all.

python docs/site/gallery.py out/gallery [--data FOLDER] [--only NAME…] [--images]

The example characters are always there; `--data` adds freely licensed models, where the folder has them. `--images`
also writes the animated images of the example characters to docs/images/gallery, each beside its performer. The pages
need no network. They need what `make studio` builds.
"""

import argparse
import base64
import html
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import av
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from capture.formats import read_log
from capture.skeleton import JOINT_INDEX, to_character_axes
from capture.timeline import Timeline, choose, resample
from engine_bridge.character.examples import MOTIONS, prepare
from engine_bridge.cli.main import main as puppetline
from engine_bridge.film.film import make_video
from engine_bridge.pictures import stick_figure
from engine_bridge.pictures.view import View

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "engine_bridge" / "studio" / "page"
FPS = 24
SIZE = 480
"""Width and height of a video, in pixels."""

IMAGE_SIZE, IMAGE_FPS, PERFORMER_SIZE = 288, 12, (84, 126)
"""The same of an animated image, and the width and height of the performer in its corner."""

CC0, CC_BY = "CC0 1.0", "CC BY 4.0"
ADDRESSES = {
    CC0: "https://creativecommons.org/publicdomain/zero/1.0/",
    CC_BY: "https://creativecommons.org/licenses/by/4.0/",
}
"""Texts of the licences, which the pages link to."""

QUATERNIUS, KAYKIT, KENNEY = "Quaternius", "KayKit (Kay Lousberg)", "Kenney"

WHOLE, PAW = (0.0, 1e3), (3.0, 8.4)
"""The whole of a recording, and the part of the example "bark" in which the performer raises a hand, in seconds."""


class Model(NamedTuple):
    """A model, the recording that it plays, and who made it.

    `mesh` is its path in the data folder, empty for an example character. `recording` is an example motion, or a path
    in the data folder. `part` is the part of the recording in seconds in which the loop is sought. `axes` are options
    of `puppetline new`, for a model whose front is not recognised.
    """

    name: str
    mesh: str
    recording: str
    author: str
    licence: str
    part: tuple[float, float] = WHOLE
    azimuth: float = 25.0
    axes: tuple[str, ...] = ()


MODELS = (
    *(
        Model(name, "", motion, "Puppetline", "MIT", PAW if name == "dog" else WHOLE)
        for name, motion in MOTIONS.items()
    ),
    Model("husky", "mesh/gltf/quaternius_Husky.glb", "walk", QUATERNIUS, CC0),
    Model("fox", "mesh/gltf/quaternius_Fox.glb", "bark", QUATERNIUS, CC0, PAW),
    Model("trex", "mesh/gltf/quaternius_Trex.glb", "roar", QUATERNIUS, CC0),
    Model("horse", "mesh/gltf/quaternius_Horse.glb", "rear", QUATERNIUS, CC0),
    Model("cow", "mesh/gltf/quaternius_Cow.glb", "walk", QUATERNIUS, CC0),
    Model("alpaca", "mesh/gltf/quaternius_Alpaca.glb", "rear", QUATERNIUS, CC0),
    Model("parasaurolophus", "mesh/gltf/quaternius_Parasaurolophus.glb", "roar", QUATERNIUS, CC0),
    Model("stegosaurus", "mesh/gltf/quaternius_Stegosaurus.glb", "walk", QUATERNIUS, CC0),
    Model("frog", "mesh/gltf/quaternius_Frog.glb", "rear", QUATERNIUS, CC0),
    Model("rat", "mesh/gltf/quaternius_Rat.glb", "walk", QUATERNIUS, CC0),
    Model("snake", "mesh/gltf/quaternius_Snake.glb", "kung_fu", QUATERNIUS, CC0),
    Model("shark", "mesh/gltf/quaternius_Shark.glb", "bark", QUATERNIUS, CC0, PAW, 45.0, ("--up", "y", "--front", "z")),
    Model("adventurer", "mesh/gltf/quaternius_Adventurer.glb", "kung_fu", QUATERNIUS, CC0),
    Model("witch", "mesh/gltf/quaternius_Witch.glb", "kung_fu", QUATERNIUS, CC0),
    Model("george", "mesh/gltf/quaternius_George.glb", "bvh/jumping_jacks.bvh", QUATERNIUS, CC0),
    Model("leela", "mesh/gltf/quaternius_Leela.glb", "walk", QUATERNIUS, CC0),
    Model("knight", "mesh/gltf/kaykit_Knight.glb", "kung_fu", KAYKIT, CC0),
    Model("kenney", "mesh/gltf/kenney/character.glb", "bvh/jumping_jacks.bvh", KENNEY, CC0),
    Model("khronos-fox", "mesh/gltf/khronos_Fox.glb", "walk", "PixelMannen, tomkranis", f"{CC0}, rig {CC_BY}"),
)


def run(*arguments: object) -> None:
    """Run a command of Puppetline."""
    puppetline([str(each) for each in arguments], standalone_mode=False)


def make(model: Model, folder: Path, data: Path | None) -> tuple[float, float]:
    """Write the files of a model; return the loop of its recording, in seconds."""
    log, puppet = prepared(model, folder, data)
    loop = best_loop(timeline_of(log), model.part)
    scene = folder / f"{model.name}.film.toml"
    scene.write_text(
        f"""[film]
size = [{SIZE}, {SIZE}]
fps = {FPS}
[[character]]
name = "it"
puppet = "{puppet.name}"
[[take]]
character = "it"
file = "{log}"
start = {loop[0]:.3f}
stop = {loop[1]:.3f}
loop = 3
[[camera]]
shot = "follow"
azimuth = {model.azimuth}
"""
    )
    seconds = loop[1] - loop[0]
    make_video(scene, folder / f"{model.name}.webm", seconds, 2 * seconds - 0.3, False, lambda *_: None)
    run("convert", log, "--puppet", puppet, "-o", folder / f"{model.name}.animated.glb")
    return loop


def prepared(model: Model, folder: Path, data: Path | None) -> tuple[Path, Path]:
    """Write the puppet file and the recording of a model; return their paths."""
    if not model.mesh:
        return prepare(model.name, folder)
    puppet = folder / f"{model.name}.toml"
    run("new", Path(data or "") / model.mesh, "-o", puppet, "--force", *model.axes)
    if model.recording in MOTIONS.values():
        maker = next(name for name, motion in MOTIONS.items() if motion == model.recording)
        return prepare(maker, folder / "examples")[0].resolve(), puppet
    return (Path(data or "") / model.recording).resolve(), puppet


def timeline_of(log: Path) -> Timeline:
    """Return the performer of a recording, at the rate of the video."""
    return resample(choose(read_log(log))[0], fps=FPS)


def best_loop(timeline: Timeline, part: tuple[float, float]) -> tuple[float, float]:
    """Return the part of a recording, of 2.5 to 5 s, that ends as it begins and has much motion in it."""
    joints = timeline.positions - timeline.positions[:, :1]
    speed = np.gradient(joints, 1 / FPS, axis=0)
    motion = np.cumsum(np.linalg.norm(speed, axis=2).mean(axis=1)) / FPS
    first, last = (int(np.clip(each * FPS, 0, len(joints) - 1)) for each in part)
    best = (np.inf, 0, len(joints) - 1)
    for start in range(first, last - int(2.5 * FPS)):
        ends = np.arange(start + int(2.5 * FPS), min(start + 5 * FPS, last))
        apart = np.linalg.norm(joints[ends] - joints[start], axis=2).mean(axis=1)
        apart += 0.2 * np.linalg.norm(speed[ends] - speed[start], axis=2).mean(axis=1)
        cost = (apart + 0.05) / (motion[ends] - motion[start]) * np.sqrt(ends - start)
        if cost.min(initial=np.inf) < best[0]:
            best = (float(cost.min()), start, int(ends[cost.argmin()]))
    return best[1] / FPS, best[2] / FPS


def write_image(model: Model, folder: Path, loop: tuple[float, float], path: Path) -> None:
    """Write the animated image of a video, with the performer in its corner."""
    log, _ = prepared(model, folder, None)
    joints = to_character_axes(timeline_of(log).positions)
    joints = joints - joints[:, JOINT_INDEX["hip_center"], None]
    view = replace(View.around(joints, size=PERFORMER_SIZE), radius=0.75)
    images = []
    for number, frame in enumerate(frames_of(folder / f"{model.name}.webm")):
        if number % (FPS // IMAGE_FPS):
            continue
        image = Image.fromarray(frame).resize((IMAGE_SIZE, IMAGE_SIZE), Image.Resampling.LANCZOS)
        begin = round(loop[0] * FPS)  # the video begins a cross-fade after the loop
        at = begin + (number + round(0.3 * FPS)) % (round(loop[1] * FPS) - begin)
        performer = Image.fromarray(stick_figure.draw(joints[at], view, PERFORMER_SIZE))
        image.paste(performer, (6, IMAGE_SIZE - PERFORMER_SIZE[1] - 6))
        images.append(image)
    path.parent.mkdir(parents=True, exist_ok=True)
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=1000 // IMAGE_FPS, loop=0, quality=58, method=3
    )


def frames_of(video: Path) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames of a video."""
    with av.open(str(video)) as container:
        for frame in container.decode(video=0):
            yield np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)


def write_pages(models: list[Model], folder: Path) -> None:
    """Write the player, a page for each model, and the page of all."""
    shutil.copy(PAGE / "dist" / "player.js", folder)
    template = Path(__file__).with_name("gallery.html").read_text(encoding="utf-8")
    for model in models:
        file = base64.b64encode((folder / f"{model.name}.animated.glb").read_bytes()).decode()
        links = f'<a href="index.html">All</a> · <a href="{model.name}.animated.glb" download>Save the .glb</a>'
        body = (
            f'<p>{links} · {credit(model)}</p><canvas aria-label="{model.name}, animated; drag to turn it"></canvas>'
            f'<script type="text/plain" id="glb">{file}</script><script src="player.js"></script>'
        )
        (folder / f"{model.name}.html").write_text(filled(template, model.name.capitalize(), body), encoding="utf-8")
    items = "".join(
        f'<li><a href="{model.name}.html"><video src="{model.name}.webm" autoplay loop muted playsinline></video>'
        f"{model.name.capitalize()}</a><small>{credit(model)}</small></li>"
        for model in models
    )
    (folder / "index.html").write_text(filled(template, "Gallery", f"<ul>{items}</ul>"), encoding="utf-8")


def credit(model: Model) -> str:
    """Return who made a model, its licence, and that it was changed, which licences require."""
    text = html.escape(f"{model.author}, {model.licence}")
    for name, address in ADDRESSES.items():
        text = text.replace(name, f'<a href="{address}">{name}</a>')
    return f"{text}, animated by Puppetline" if model.mesh else text


def filled(template: str, title: str, body: str) -> str:
    """Return a page."""
    return template.replace("{title}", title).replace("{body}", body)


def main(arguments: list[str] | None = None) -> None:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--data", type=Path, help="folder with the models that are not examples")
    parser.add_argument("--only", nargs="+", help="names of models")
    parser.add_argument("--images", action="store_true", help="write docs/images/gallery too")
    options: Any = parser.parse_args(arguments)
    folder = options.folder.resolve()  # a scene finds its recordings beside itself
    folder.mkdir(parents=True, exist_ok=True)
    models = [
        model
        for model in MODELS
        if (not options.only or model.name in options.only)
        and (not model.mesh or (options.data and (options.data / model.mesh).is_file()))
    ]
    for model in models:
        loop = make(model, folder, options.data)
        video = folder / f"{model.name}.webm"
        print(f"{model.name}: {loop[0]:.2f} to {loop[1]:.2f} s, {video.stat().st_size / 1000:.0f} kB")  # noqa: T201
        if options.images and not model.mesh:
            write_image(model, folder, loop, ROOT / "docs" / "images" / "gallery" / f"{model.name}.webp")
    write_pages(models, folder)


if __name__ == "__main__":
    main()
