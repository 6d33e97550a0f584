"""The command `puppetline studio` and its page in Chromium, for measurements and images."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

SIZE = {"width": 1280, "height": 720}

CAMERA = {"PYTHONPATH": str(Path(__file__).parents[1] / "tests" / "engine_bridge" / "studio" / "virtual_camera")}
"""Environment of a process that has a virtual camera."""


@contextmanager
def chromium() -> Iterator[Any]:
    """Start Chromium without a graphics card; yield Playwright's browser."""
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium") or shutil.which("google-chrome")
    angle = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=program, args=[*angle, "--disable-gpu-compositing", "--no-sandbox"]
        )
        yield browser
        browser.close()


@contextmanager
def command(*arguments: object, **environment: str) -> Iterator[Iterator[str]]:
    """Run a command of Puppetline that serves the page; yield the addresses that it prints, one after another."""
    program = [sys.executable, "-m", "puppetline", *map(str, arguments)]
    own = os.environ | {"PYTHONDONTWRITEBYTECODE": ""} | environment  # bytecode is written, as in an installation
    process = subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=own)
    try:
        yield (found[0] for line in process.stdout or () if (found := re.search(r"http://\S+", line)))
    finally:
        process.terminate()
        process.wait()


@contextmanager
def studio(folder: Path, *arguments: object, **environment: str) -> Iterator[Iterator[str]]:
    """Run a studio that keeps everything in a folder; yield the addresses that it prints."""
    given = ["studio", "--no-browser", "--port", 0, "--folder", folder, *arguments]
    with command(*given, **environment) as addresses:
        yield addresses


def until(page: Any, expression: str, seconds: float = 300.0) -> Any:
    """Wait until a JavaScript expression about the page's `state` is true; return its value."""
    asked = f"() => {{ const state = studio.state(); return {expression}; }}"
    # if it were asked at each image, the page would have to be composed for that
    return page.wait_for_function(asked, timeout=1000 * seconds, polling=50).json_value()
