"""The studio's page without a browser: its own tests (page/test/*.ts), whose server must be like the real one."""

import gzip
import json
import os
import re
import shutil
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from engine_bridge.puppet.puppet_values import puppet_of
from engine_bridge.studio.messages import characters, connection, film, film_plan, performers, typescript
from engine_bridge.studio.messages.requests import REQUESTS
from engine_bridge.studio.messages.state import ProgressEvent, SourceState, State

from ...conftest import ROOT, missing

PAGE = ROOT / "engine_bridge" / "studio" / "page"

MAX_PAGE_BYTES = 400_000
"""Maximum size of the page as gzip sends it."""

REPLIES = {
    "puppet": characters.PuppetReply,
    "edit": characters.PuppetReply,
    "change_plan": characters.PuppetReply,
    "edit_film": film.FilmState,
    "plan_film": film_plan.FilmPlan,
    "share_film": film.ShareReply,
    "sources": performers.Sources,
    "look": performers.LookReply,
    "smoothing_preview": performers.SmoothingReply,
    "source": SourceState | dict,
}
"""Classes of results by requests."""


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    """Run the page's tests; return the frames that the page and the server of these tests have sent to each other."""
    beside = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    program = shutil.which("node", path=beside)
    if program is None or not (PAGE / "node_modules" / "esbuild").is_dir():
        missing("node", "node or the packages of the page are not installed (make studio)")
    path = tmp_path_factory.mktemp("frames") / "frames.jsonl"
    result = subprocess.run(
        [program, PAGE / "test.mjs"], capture_output=True, text=True, env=os.environ | {"STUDIO_FRAMES": str(path)}
    )
    assert result.returncode == 0, result.stdout
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def test_the_page_does_what_its_own_tests_say_with_requests_that_the_server_accepts(frames):
    requests = [frame["request"] for frame in frames if "request" in frame]
    for request in requests:
        REQUESTS[request["do"]].model_validate(request)
        if request["do"] == "edit":
            puppet_of(request["puppet"], "figure.glb")
    programs = {"ping", "state"}  # of programs other than the page
    assert {request["do"] for request in requests} | programs == {*REQUESTS}


def test_the_server_of_the_pages_tests_sends_what_the_real_one_does(frames):
    kinds = {"hello": connection.Greeting, "state": State}
    for frame in frames:
        for key in kinds.keys() & frame:
            kinds[key].model_validate(frame[key])
        if frame.get("event") == "progress":
            ProgressEvent.model_validate(frame)
        if {"request", "result"} <= frame.keys():
            TypeAdapter(REPLIES.get(frame["request"]["do"], dict)).validate_python(frame["result"])


@pytest.mark.parametrize("page", ["index.html", "screen.html"])
def test_a_page_is_small(page):
    of_screen = {"screen.css", "screen.js"}
    assets = {path.name for path in (PAGE / "dist" / "assets").iterdir()}
    assert of_screen < assets
    loaded = of_screen if page == "screen.html" else assets - of_screen
    files = [PAGE / "dist" / page, *(PAGE / "dist" / "assets" / name for name in loaded)]
    assert 0 < sum(len(gzip.compress(path.read_bytes())) for path in files) <= MAX_PAGE_BYTES


def test_modules_of_the_page_do_not_import_in_circles():
    source, imports = PAGE / "src", {}
    for file in source.rglob("*.ts"):
        named = re.findall(r'from "(\.[^"]*)"', file.read_text(encoding="utf-8"))
        imports[file] = [(file.parent / name).resolve().with_suffix(".ts") for name in named]
    order = [*TopologicalSorter(imports).static_order()]
    assert order.index(source / "requests.ts") < order.index(source / "film.ts")


def test_the_page_has_the_types_of_what_the_server_sends():
    """If it does not, call `make messages`."""
    for name, text in typescript.files().items():
        assert (typescript.FOLDER / name).read_text(encoding="utf-8") == text
