"""Films of two example characters: what a frame costs, and ten seconds of 720p.

Run ``python -m benchmarks.film``. Processor time is that of all threads. A frame's is the minimum of some rounds.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil

from engine_bridge.character import examples
from engine_bridge.character.materials import drawn_normals, materials_of
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.pictures.camera import Camera
from engine_bridge.pictures.geometry import geometry_of
from engine_bridge.pictures.renderer import Renderer
from engine_bridge.pictures.surroundings import StageExtent, Surroundings
from engine_bridge.pictures.textures import textures_of

SIZE = (1280, 720)
ROUNDS = 5
FRAMES_PER_ROUND = 10

SCENE = """
[film]
seconds = 10

[[sound]]
file = "film.wav"
"""
ACTOR = """
[[character]]
name = "{name}"
puppet = "human.toml"
position = [{x}, 0.0]
height = 1.6

[[take]]
character = "{name}"
file = "kung_fu.log"
"""


def processor_seconds(work: Callable[[], object]) -> float:
    """Return the processor time of some work, in all threads."""
    before = time.process_time()
    work()
    return time.process_time() - before


def measure_frame(folder: Path) -> None:
    """Print the cost of a frame."""
    character = load_prepared(folder / "human.toml").character
    vertices, normals = character.vertices.astype(np.float32), drawn_normals(character).astype(np.float32)
    both = [vertices + np.array([x, 0, 0], np.float32) for x in (-0.9, 0.9)]
    camera = Camera(np.array([0.6, 1.4, 5.0]), np.array([0.0, 0.85, 0.0]), 30)
    drawn = geometry_of([(character.parts, materials_of(character))] * 2)
    grey = np.full((1, 1, 4), 230, np.uint8)
    around = Surroundings(grey, textures_of([grey], np.linspace(0, 1, 256, dtype=np.float32)))
    stage, renderer = StageExtent(np.zeros(3), 1.6, 1.7, 1.6), Renderer(SIZE)

    def draw() -> None:
        for _ in range(FRAMES_PER_ROUND):
            renderer.draw(camera, stage, drawn, [(places, normals) for places in both], around)

    draw()
    seconds = min(processor_seconds(draw) for _ in range(ROUNDS)) / FRAMES_PER_ROUND
    print(f"{2 * len(vertices):,} vertices, {SIZE[0]} × {SIZE[1]}")
    print(f"a frame: {1000 * seconds:.0f} ms of processor time")


def measure_film(folder: Path) -> None:
    """Print the cost of ten seconds."""
    scene = folder / "scene.toml"
    scene.write_text(SCENE + "".join(ACTOR.format(name=name, x=x) for name, x in (("a", -0.9), ("b", 0.9))))
    started = time.monotonic()
    command = [sys.executable, "-m", "puppetline", "film", str(scene), "-o", str(folder / "film.mp4")]
    process = psutil.Popen(command, stdout=subprocess.DEVNULL)
    waited = memory = used = 0.0
    while process.poll() is None:
        with contextlib.suppress(psutil.Error, OSError):
            waited = queued_seconds(process.pid)
            family = [process, *process.children()]  # those that draw, too
            memory = max(memory, sum(each.memory_info().rss for each in family))
            used = max(used, sum(sum(each.cpu_times()[:2]) for each in family))
        time.sleep(0.2)
    print(
        f"ten seconds: {time.monotonic() - started:.0f} s, of them {waited:.0f} s without a processor; "
        f"{used:.0f} s of processor time, {memory / 1e6:.0f} MB at most, load {os.getloadavg()[0]:.1f}"
    )


def queued_seconds(pid: int) -> float:
    """Return how long the main thread of a process was ready and had no processor (Linux)."""
    return int(Path(f"/proc/{pid}/task/{pid}/schedstat").read_text(encoding="ascii").split()[1]) / 1e9


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        examples.prepare_film(Path(made))
        measure_frame(Path(made))
        measure_film(Path(made))
