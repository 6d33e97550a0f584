"""Measure how long a visitor of a kiosk takes from stepping in to the film on a phone.

python -m benchmarks.kiosk_visitor PUPPET

The service plays a recording of a visitor, Chromium shows the screen, and a second context of Chromium, of a phone's
size, opens the address of the QR code. OpenCV reads it from a picture of the screen if it is installed; otherwise, the
address is the one that is written below it.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from benchmarks.live_peers import free_tcp_ports
from benchmarks.visitor import write_visitor

SETTINGS = """
announce = false
[network]
port = {port}
[kiosk]
phone_port = {phones}
phone_address = "http://127.0.0.1:{phones}"
size = [1280, 720]
[[stage]]
source = "replay:visitor.log?loop"
[[stage.character]]
puppet = "{puppet}"
"""

PHASES = ("attract", "stand", "raise", "count", "recording", "making", "film")

AWAY_SECONDS = 150.0
"""Time until the next visitor, in seconds: longer than the film of the one before has the screen."""

GIVE_UP_MS = 900_000
"""Time after which a phase counts as never reached, in milliseconds."""

DRAWING = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
"""Options of Chromium to draw without a graphics card."""


def read_code(picture: bytes) -> str:
    """Return the text of the QR code in a picture; empty if OpenCV is not installed."""
    try:
        import cv2
        import numpy as np
    except ImportError:
        return ""
    return str(cv2.QRCodeDetector().detectAndDecode(cv2.imdecode(np.frombuffer(picture, np.uint8), 1))[0])


def visit(browser: Any, folder: Path) -> None:
    """Follow a visitor on the screen and on the phone, and print the seconds of each step."""
    screen = browser.new_context(viewport={"width": 1280, "height": 720}).new_page()
    while not (address := re.search(r"http://\S+/kiosk#key=\S+", (folder / "output").read_text())):
        time.sleep(0.05)
    screen.goto(address[0])
    began = 0.0
    for phase in PHASES:
        screen.wait_for_function("phase => document.body.dataset.phase === phase", arg=phase, timeout=GIVE_UP_MS)
        began = time.monotonic() if phase == "stand" else began
        if began:
            print(f"{time.monotonic() - began:6.1f} s  {phase}", flush=True)
    screen.wait_for_function("document.querySelector('main .code')?.naturalWidth")
    written = screen.evaluate("[...document.querySelector('.address').childNodes].map((e) => e.textContent).join('/')")
    code = read_code(screen.screenshot())
    if code not in ("", f"http://{written}"):
        raise SystemExit(f"the QR code says {code}, and the screen {written}")
    phone = browser.new_context(viewport={"width": 390, "height": 844}, is_mobile=True).new_page()
    phone.goto(code or f"http://{written}")
    while not phone.evaluate("document.querySelector('video').currentTime > 0"):  # it forbids `wait_for_function`
        phone.wait_for_timeout(50)
    read = "by its QR code" if code else "by its address"
    print(f"{time.monotonic() - began:6.1f} s  the film plays on the phone, {read}")


def main() -> None:
    """Run the measurement."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("puppet", type=Path)
    arguments = parser.parse_args()
    ports = {"port": free_tcp_ports(), "phones": free_tcp_ports()}
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name, sync_playwright() as playwright:
        folder = Path(name)
        write_visitor(folder / "visitor.log", away=AWAY_SECONDS)
        settings = SETTINGS.format(**ports, puppet=arguments.puppet.resolve())
        (folder / "kiosk.toml").write_text(settings)
        command = [sys.executable, "-m", "puppetline", "serve", "--config", "kiosk.toml", "--studio"]
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=DRAWING)
        with (folder / "output").open("w") as output:
            environment = os.environ | {"XDG_STATE_HOME": name, "PYTHONUNBUFFERED": "1"}
            service = subprocess.Popen(
                [*command, str(free_tcp_ports())], cwd=folder, stdout=output, stderr=output, env=environment
            )
            try:
                visit(browser, folder)
            finally:
                service.terminate()
                service.wait()


if __name__ == "__main__":
    main()
