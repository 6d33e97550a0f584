"""Try the archives of `make dist`, each installed into an empty folder, with an empty home.

python packaging/try_archives.py dist FOLDER

Installing uses the package registries. All that follows runs without a network (`unshare`): the first commands, the
page of the studio and a new web page in Chromium, the addon in a new project of Godot. Godot is `godot` or the
environment variable GODOT. Prints what was tried, in seconds; ends at the first failure. FOLDER must not exist.
"""

import os
import re
import shutil
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
TIMEOUT_SECONDS = 600.0
"""Time after which a try fails, in seconds; the first one compiles."""

START = (ROOT / "docs" / "start" / "web.md").read_text(encoding="utf-8")
"""The page by which a newcomer shows a character in a web page; its commands and its page are tried as they are."""

GODOT_SCRIPT = """extends SceneTree
var puppet: Node3D
func _initialize() -> void:
	puppet = load("res://addons/puppetline/puppet_3d.gd").new()
	root.add_child(puppet)
func _process(_delta: float) -> bool:
	if puppet.statistics()["calibrated"]:
		print("a character moves in Godot")
		return true
	return false
"""


def run(*command: object, folder: Path, **environment: str) -> str:
    """Run a command in a folder, with the home beside it; return its output."""
    done = subprocess.run(
        [str(each) for each in command],
        cwd=folder,
        env=clean(folder, **environment),
        capture_output=True,
        text=True,
        timeout=TIMEOUT_SECONDS,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def clean(folder: Path, **more: str) -> dict[str, str]:
    """Return an environment with an empty home and without settings of Python or of the user's folders."""
    kept = {name: os.environ[name] for name in ("PATH", "LANG", "SSL_CERT_FILE", "GODOT") if name in os.environ}
    registries = {name: value for name, value in os.environ.items() if name.startswith(("PIP_", "UV_", "npm_config_"))}
    home = folder / "home"
    home.mkdir(exist_ok=True)
    return kept | registries | {"HOME": str(home), "CC": "false", "CXX": "false"} | more


def tried(what: str, work: Callable[[], object]) -> None:
    """Do something and print how long it took."""
    start = time.monotonic()
    work()
    print(f"{what:60} {time.monotonic() - start:7.1f} s", flush=True)


def install(dist: Path, folder: Path) -> None:
    """Install the wheel in three ways, the npm package, and the addon in a new project of Godot."""
    (wheel,) = dist.glob("*.whl")
    constraint = folder / "constraints.txt"  # without hashes, with which pip would ask for one of the wheel
    pinned = (ROOT / "requirements.txt").read_text(encoding="utf-8").replace(" \\\n", "\n")
    constraint.write_text(re.sub("^ .*\n", "", pinned, flags=re.MULTILINE))
    places = {
        "UV_TOOL_DIR": str(folder / "uv" / "tools"),
        "UV_TOOL_BIN_DIR": str(folder / "uv" / "bin"),
        "PIPX_HOME": str(folder / "pipx" / "home"),
        "PIPX_BIN_DIR": str(folder / "pipx" / "bin"),
    }
    in_folder = partial(run, folder=folder, **places)
    in_folder(sys.executable, "-m", "venv", folder / "pip")
    tried("pip install", lambda: in_folder(folder / "pip" / "bin" / "pip", "install", "-qc", constraint, wheel))
    tried("pipx install", lambda: in_folder("pipx", "install", "--pip-args", f"-c {constraint}", wheel))
    tried("uv tool install", lambda: in_folder("uv", "tool", "install", "-q", "-c", constraint, wheel))
    site = folder / "site"
    site.mkdir()
    (archive,) = dist.glob("puppetline-web-*.tgz")
    shutil.copy(archive, site)
    (install_modules,) = re.findall(r"^npm install .*", START, re.MULTILINE)
    tried("npm install", lambda: run(*install_modules.split(), folder=site))
    (page,) = re.findall(r"^```html\n(.*?)^```", START, re.MULTILINE | re.DOTALL)
    (site / "index.html").write_text(page.replace("const puppet", "const puppet = window.puppet"), encoding="utf-8")
    game = folder / "game"
    game.mkdir()
    zipfile.ZipFile(next(dist.glob("puppetline-godot-*.zip"))).extractall(game)
    plugin = '[editor_plugins]\nenabled=PackedStringArray("res://addons/puppetline/plugin.cfg")\n'
    (game / "project.godot").write_text(f'config_version=5\n[application]\nconfig/name="New"\n{plugin}')
    (game / "try.gd").write_text(GODOT_SCRIPT)


def compile_for_unity(dist: Path, folder: Path) -> None:
    """Compile the Unity package of the archive with the tests' stand-ins for Unity."""
    (archive,) = dist.glob("com.puppetline.unity-*.tgz")
    shutil.unpack_archive(archive, folder / "unity")
    test = "tests/integrations/unity/test_package.py"
    environment = os.environ | {"PUPPETLINE_UNITY_PACKAGE": str(folder / "unity" / "package")}
    environment["PUPPETLINE_TEST_REQUIRE"] = "mono"
    subprocess.run([sys.executable, "-m", "pytest", "-q", test], cwd=ROOT, env=environment, check=True)


@contextmanager
def started(*command: object, folder: Path, until: str) -> Iterator[str]:
    """Start a command in a folder; return the line in which it says `until`, and end the command as Ctrl-C does."""
    process = subprocess.Popen(
        [str(each) for each in command],
        cwd=folder,
        env=clean(folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None
    said: list[str] = []
    try:
        for line in process.stdout:
            said.append(line)
            if until in line:
                break
        else:
            raise SystemExit("".join(said))
        threading.Thread(target=process.stdout.read, daemon=True).start()
        yield line
    finally:
        process.send_signal(2)
        if process.wait(60):
            raise SystemExit(f"{command}: exit code {process.returncode}\n{''.join(said)}")


def shown(browser: Any, address: str, expression: str, picture: Path, click: str = "") -> None:
    """Open a page and wait until an expression is true; fail if the page reports an error."""
    page = browser.new_page()
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.goto(address)
    if click:
        page.get_by_role("button", name=re.compile(click)).first.click()
    page.wait_for_function(expression, timeout=1000 * TIMEOUT_SECONDS)
    page.wait_for_timeout(1000)
    page.screenshot(path=picture)
    if problems:
        raise SystemExit("\n".join(problems))


def offline(folder: Path) -> None:
    """Try what was installed, where there is no network."""
    from playwright.sync_api import sync_playwright

    puppetline = folder / "uv" / "bin" / "puppetline"
    for way in ("pip", "pipx", "uv"):
        tried(
            f"{way}: puppetline --version",
            partial(run, folder / way / "bin" / "puppetline", "--version", folder=folder),
        )
    tried("puppetline demo, the first time", partial(run, puppetline, "demo", folder=folder))
    tried("puppetline demo, again", partial(run, puppetline, "demo", folder=folder))
    demo, serve = (line.split()[1:] for line in re.findall("^puppetline .*", START, re.MULTILINE))
    run(puppetline, *demo, folder=folder)
    handler = partial(SimpleHTTPRequestHandler, directory=str(folder / "site"))
    handler.func.log_message = lambda *_: None  # type: ignore[method-assign]
    site = ThreadingHTTPServer(("127.0.0.1", 8000), handler)
    threading.Thread(target=site.serve_forever, daemon=True).start()
    with sync_playwright() as playwright:
        chromium = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(
            executable_path=chromium, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        studio = ("studio", "--no-browser")
        with started(puppetline, *studio, folder=folder, until="The studio is at") as line:
            moves = "studio.state().server?.characters.length && studio.viewer.shown(studio.state().character)?.moment"
            tried(
                "the studio shows an example that moves",
                lambda: shown(browser, line.split()[-1], moves, folder / "studio.png", "^Dog"),
            )
        with started(puppetline, *serve, "--no-announce", folder=folder, until="serving"):
            site_shows = partial(shown, browser, "http://localhost:8000", "window.puppet?.mesh", folder / "page.png")
            tried("a new page shows a character", site_shows)
            if godot := shutil.which(os.environ.get("GODOT", "godot")):
                in_game = partial(run, godot, "--headless", "--path", folder / "game", folder=folder)
                tried("Godot imports the addon", lambda: in_game("--import"))
                tried("a character moves in Godot", lambda: in_game("--script", "res://try.gd"))
        browser.close()


def main() -> None:
    """Run the script."""
    if sys.argv[1] == "--offline":
        offline(Path(sys.argv[2]))
        return
    dist, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
    folder.mkdir(parents=True)
    install(dist, folder)
    if shutil.which("mcs"):
        tried("Unity package compiled", lambda: compile_for_unity(dist, folder))
    alone = 'ip link set lo up && exec "$@"'
    command = ("unshare", "-rn", "sh", "-c", alone, "sh", sys.executable, __file__, "--offline", str(folder))
    sys.exit(subprocess.run(command, check=False).returncode)


if __name__ == "__main__":
    main()
