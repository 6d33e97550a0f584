"""Installs extras of Puppetline with pip."""

import re
import subprocess
import sys
from importlib.metadata import requires
from importlib.util import find_spec

from engine_bridge.studio.long_work.worker import Progress
from puppetline.errors import ServiceError

MODULES = {"camera": ("mediapipe", "cv2"), "film": ("av",), "sound": ("sounddevice",)}
"""Modules that each extra brings."""

ABOUT_PACKAGES = {"camera": 38, "film": 3, "sound": 3}
"""Approximate number of packages that pip reports for each extra, for the progress."""

TITLES = {
    "camera": "Getting the webcam ready",
    "film": "Getting ready to make films",
    "sound": "Getting the microphone ready",
}
"""What installing each extra is called, for people."""


def is_installed(extra: str) -> bool:
    """Tell whether all modules of an extra can be found."""
    return all(find_spec(name) is not None for name in MODULES[extra])


def install_extra(extra: str, progress: Progress) -> None:
    """Install the packages of an extra, with the versions that Puppetline requires.

    Raises
    ------
    ServiceError
        pip has failed.
    """
    wanted = [
        match[1]
        for each in requires("puppetline") or ()
        if (match := re.fullmatch(rf"(.+?)\s*;\s*extra == ['\"]{extra}['\"]", each))
    ]
    command = [sys.executable, "-m", "pip", "install", "--disable-pip-version-check", "--no-input", *wanted]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)  # noqa: S603
    assert process.stdout is not None  # noqa: S101 - a pipe was asked for
    lines, found = [""], 0
    for line in process.stdout:
        lines.append(line.strip())
        if line.startswith(("Collecting", "Requirement already")):
            found += 1
            progress("Downloading", min(found / ABOUT_PACKAGES[extra], 0.95))
        elif line.startswith("Installing"):
            progress("Installing", 0.97)
    if process.wait():
        raise ServiceError(
            "the installation",
            found=f"an error of pip: {lines[-1] or 'no message'}"[:300],
            expected="an internet connection, and a Python with pip",
            fix=f"Try again, or type: pip install 'puppetline[{extra}]'",
        )
