"""Time that characters cost a game in Godot by controls: ``python -m benchmarks.godot [--data FOLDER]``.

The real service plays a recording on each character. Godot (from the environment variable GODOT, or on PATH) runs
without a display and shows each character with one Puppet3D, at 60 frames per second. The script of the node is timed,
and so are the reading of the connection, which all nodes of a service share, and 16 attachments to the first
character. Before, while the characters are loaded, whole frames are timed. The work of the graphics card is not timed.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import character_cost
from benchmarks.own_cache import own_cache
from engine_bridge.inspection.benchmark import CHARACTER, LOG, number
from engine_bridge.performance.prepared_character import load_prepared

ADDON = Path(__file__).parents[1] / "integrations" / "godot" / "addons" / "puppetline"
SCRIPT = Path(__file__).with_suffix(".gd")
CHARACTER_COUNTS = (1, 4, 16)
GOAL_MS = 0.3
"""Largest time of the script per frame and character, in milliseconds."""
ATTACHMENT_GOAL_MS = 0.02
"""Largest time of the script per frame and attachment, in milliseconds."""
LOADING_GOAL_MS = 8.0
"""Longest frame while a character is loaded, in milliseconds."""
PROJECT = 'config_version=5\n[application]\nconfig/name="Benchmark"\n'
TRANSFORM_BYTES = 48
"""Size of an affine transform, in bytes."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="a folder that contains armadillo.obj")
    options = parser.parse_args()
    mesh = min(options.data.rglob("armadillo.obj"), default=None) if options.data else None
    godot = shutil.which(os.environ.get("GODOT", "godot"))
    if godot is None:
        parser.error("Godot was not found: put godot on PATH, or its path in GODOT")
    with tempfile.TemporaryDirectory() as place, own_cache(Path(place)):
        folder = Path(place)
        character = character_cost.prepare(folder, mesh, 900)
        load_prepared(folder / CHARACTER)  # so that all processes find it in the cache
        project = _make_project(godot, folder / "project")
        found = {count: _measure(godot, project, folder, count) for count in CHARACTER_COUNTS}
        model = load_prepared(folder / CHARACTER).model
        upload = TRANSFORM_BYTES * len(model.rest_controls) // 4
    version = subprocess.run([godot, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    load = os.getloadavg()[0]
    print(f"{character['name']}: {character['vertices']:,} vertices; Godot {version}; load {load:.1f} after\n")
    print("\n".join(_table(found, upload)))


def _make_project(godot: str, folder: Path) -> Path:
    shutil.copytree(ADDON, folder / "addons" / "puppetline")
    shutil.copy(SCRIPT, folder / "benchmark.gd")
    (folder / "project.godot").write_text(PROJECT)
    subprocess.run([godot, "--headless", "--path", folder, "--import"], capture_output=True, check=True)
    return folder


def _measure(godot: str, project: Path, folder: Path, count: int) -> dict[str, Any]:
    names = [f"character_{number}" for number in range(count)]
    for name in names:
        shutil.copy(folder / CHARACTER, folder / f"{name}.toml")
    with _serving(folder, names) as port:
        command = [godot, "--headless", "--path", project, "-s", "res://benchmark.gd", "--", port, *names]
        environment = os.environ | {"XDG_DATA_HOME": str(folder / f"user_{count}")}  # without scenes of other runs
        said = subprocess.run(
            list(map(str, command)), capture_output=True, text=True, check=True, timeout=600, env=environment
        ).stdout
    [result] = re.findall(r"^RESULT (.*)$", said, re.MULTILINE)
    found: dict[str, Any] = json.loads(result)
    return found


@contextmanager
def _serving(folder: Path, names: list[str]) -> Iterator[int]:
    """Run the service until the block ends; yield its port."""
    played = [part for name in names for part in ("--puppet", folder / f"{name}.toml")]
    sources = [part for _ in names for part in ("--source", f"replay:{folder / LOG}?loop")]
    command = [sys.executable, "-m", "puppetline", "serve", *played, *sources, "--port", "0", "--no-announce"]
    log = folder / "serve.log"
    with log.open("w") as said:
        arguments = [*map(str, command), "--log-format", "json", "--takes", str(folder / "takes")]
        with subprocess.Popen(arguments, stderr=said) as service:
            try:
                yield _port(service, log)
            finally:
                service.terminate()


def _port(service: subprocess.Popen[bytes], log: Path) -> int:
    while service.poll() is None:
        for line in log.read_text().splitlines():
            if '"serving"' in line:
                return int(json.loads(line)["fields"]["stream"][0].rpartition(":")[2])
        time.sleep(0.1)
    raise SystemExit(f"The service has ended: {log.read_text()}")


def _table(found: dict[int, dict[str, Any]], upload: int) -> Iterator[str]:
    yield (
        "| characters | script, ms per frame and character: median | mean | 99th percentile | goal | reading, mean | "
        "attachment, median | goal | longest frame while loading | goal | bytes uploaded per frame received | "
        "frames received per second |"
    )
    yield "| --- " * 12 + "|"
    for count, each in found.items():
        script, reading = (1e-3 * np.array(each[name]) for name in ("processing_us", "receiving_us"))
        middle, attachment = float(np.median(script)), float(1e-3 * np.median(each["attaching_us"]))
        figures = (middle, float(script.mean()), float(np.percentile(script, 99)))
        measured = " | ".join(map(number, figures))
        rest = f"{number(float(reading.mean()))} | {number(attachment)} | {_verdict(attachment, ATTACHMENT_GOAL_MS)}"
        loading = 1e-3 * max(each["loading_us"])
        rest += f" | {number(loading)} | {_verdict(loading, LOADING_GOAL_MS)}"
        rest += f" | {upload:,} | {each['frames_a_second']:.1f}"
        yield f"| {count} | {measured} | {_verdict(middle, GOAL_MS)} | {rest} |"


def _verdict(measured: float, goal: float) -> str:
    return f"≤ {goal:g}: {'met' if measured <= goal else f'missed, {number(measured / goal)} × the goal'}"


if __name__ == "__main__":
    main()
