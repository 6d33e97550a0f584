"""What a frame costs the scripts of the Godot addon: python -m benchmarks.godot [--data FOLDER]

Characters of a service are played 30 times a second, and shown in CONTROLS by a Puppet3D each, in a real Godot at 60
frames a second. FOLDER is searched for armadillo.obj as by `benchmarks.performance`. Godot 4 is `godot`, or what the
environment variable GODOT says. With xvfb-run at hand, frames go to an OpenGL driver, else nowhere.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from benchmarks.live_peers import free_udp_port, sender, serving, settings
from engine_bridge import bench
from engine_bridge.bench_process import CHARACTER

ADDON = Path(__file__).parents[1] / "integrations" / "godot" / "addons"
SCRIPT = Path(__file__).with_name("godot_frames.gd")
GODOT = os.environ.get("GODOT", "godot")
NUMBERS = (1, 4, 16)
RUNS = 3
FRAMES = 600
GOAL = 0.3
TRANSFORMS = 3840


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="a folder that holds armadillo.obj")
    options = parser.parse_args()
    mesh = min(options.data.rglob("armadillo.obj"), default=None) if options.data else None
    with tempfile.TemporaryDirectory() as name, bench.own_cache(Path(name)):
        subject = Path(name) / "subject"
        subject.mkdir()
        character = bench.prepare(subject, mesh, 60)
        project = make_project(Path(name) / "project")
        print(f"{character['name']}: {character['vertices']:,} vertices; {bench.machine()['processor']}")
        print("| characters | script a frame, each, ms | 99th percentile | goal, ms | uploaded a second, each |")
        print("| --- | --- | --- | --- | --- |")
        for number in NUMBERS:
            runs = [measure(Path(name), subject / CHARACTER, project, number) for _ in range(RUNS)]
            each, worst, rate = (
                median(run[key] for run in runs) / (1 if key == "arrived" else number)
                for key in ("median_ms", "p99_ms", "arrived")
            )
            print(f"| {number} | {each:.3f} | {worst:.3f} | ≤ {GOAL} | {rate:.0f} × {TRANSFORMS:,} bytes |", flush=True)


def make_project(folder: Path) -> Path:
    """Make a Godot project with the addon, and let Godot look at it once."""
    shutil.copytree(ADDON, folder / "addons")
    shutil.copy(SCRIPT, folder)
    (folder / "project.godot").write_text(
        'config_version=5\n\n[application]\n\nconfig/features=PackedStringArray("4.3", "GL Compatibility")\n\n'
        '[rendering]\n\nrenderer/rendering_method="gl_compatibility"\n',
        encoding="utf-8",
    )
    subprocess.run([GODOT, "--headless", "--path", folder, "--import"], check=True, capture_output=True)
    return folder


def measure(folder: Path, puppet: Path, project: Path, number: int) -> dict[str, float]:
    """Run Godot beside a service with so many characters, each with a performer."""
    display = ["--headless"]
    command: list[str | Path] = [GODOT]
    if shutil.which("xvfb-run"):
        display = ["--rendering-driver", "opengl3", "--audio-driver", "Dummy"]
        command = ["xvfb-run", "-a", GODOT]
    names = [f"character{n}" for n in range(1, number + 1)]
    port = free_udp_port()
    with serving(folder / f"serving{number}", settings(dict.fromkeys(names, puppet), port)) as service:
        performers = sender(port, [(30.0, 1_000_000)], number)
        stream = service.stream.rpartition(":")[2]
        script = ["--path", project, "-s", f"res://{SCRIPT.name}", "--", stream, str(FRAMES), *names]
        run = subprocess.run([*command, *display, *script], capture_output=True, text=True, check=False, timeout=300)
        performers.end()
    told = [line for line in run.stdout.splitlines() if line.startswith("RESULT ")]
    if not told:
        raise SystemExit(f"Godot has not said how it was:\n{run.stdout}\n{run.stderr}")
    print(f"{number}: {told[0]}", file=sys.stderr, flush=True)
    return json.loads(told[0].removeprefix("RESULT "))


if __name__ == "__main__":
    main()
