"""The package compiled with Mono, and programs that use it: its core alone, or all of it with stand-ins for Unity."""

import base64
import json
import os
import shutil
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.payloads import decode, encode

from ..surface import blended

HERE = Path(__file__).parent
PACKAGE = Path(os.environ.get("PUPPETLINE_UNITY_PACKAGE", HERE.parents[2] / "integrations" / "unity"))
TIMEOUT_SECONDS = 60.0
"""Time after which a test fails, in seconds."""

STRICT = ["-langversion:7.2", "-warnaserror+", "-warn:4", "-optimize+"]
"""The newest C# that mcs knows, which is older than that of Unity 2021.3; no warnings."""


class Program:
    """A running program and its output, one line of JSON per result."""

    def __init__(self, command):
        self.process = subprocess.Popen(
            list(map(str, command)), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.said = []
        self.noise = []
        self._read = threading.Thread(target=self._follow)
        self._read.start()

    def _follow(self):
        for line in self.process.stdout:
            if line.startswith("{") and line.endswith("}\n"):
                self.said.append(json.loads(line))
            else:
                self.noise.append(line)

    def tell(self, line):
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()

    def until(self, wanted, since=0):
        """Wait for something that satisfies a condition, said after the first `since` things, and return it."""
        give_up = time.monotonic() + TIMEOUT_SECONDS
        looked = since
        while True:
            alive = self._read.is_alive()
            while looked < len(self.said):
                looked += 1
                if wanted(self.said[looked - 1]):
                    return self.said[looked - 1]
            if not alive or time.monotonic() > give_up:
                others = [each for each in self.said[since:] if "frame" not in each]
                pytest.fail(f"it has not said what was wanted, but {others} {''.join(self.noise)}"[:4000])
            time.sleep(0.01)

    def finish(self, told=""):
        """Tell it the last thing and wait for its end; return all that it has said."""
        if told:
            self.tell(told)
        self.process.stdin.close()
        code = self.process.wait(TIMEOUT_SECONDS)
        self._read.join()
        assert (code, self.noise) == (0, [])
        return self.said

    def close(self):
        self.process.kill()
        self.process.wait()
        self._read.join()
        self.process.stdin.close()
        self.process.stdout.close()


@pytest.fixture(scope="session")
def built(mono, made_once):
    """Folder of the package and the programs, compiled as Unity's assembly definitions have it."""
    return made_once("built", lambda folder: build(mono[0], folder))


def build(compiler, folder):
    """Compile the package and the programs into a folder."""

    def compile_(name, sources, *references, doc=None, pattern="*.cs"):
        """Make a library of a folder's sources or, of a list, a program."""
        program = isinstance(sources, list)
        sources = sources if program else sorted(sources.glob(pattern))
        assert sources
        output = f"-out:{name}.exe" if program else f"-out:{name}.dll"
        more = [output, f"-target:{'exe' if program else 'library'}", *([f"-doc:{doc}.xml"] if doc else [])]
        libraries = [f"-r:{reference}.dll" for reference in references]
        command = [compiler, *STRICT, *more, *libraries, *map(str, sources)]
        made = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert (made.returncode, made.stdout + made.stderr) == (0, ""), name

    def program(name, *references, sources=("Said",)):
        compile_(name, [HERE / "programs" / f"{each}.cs" for each in (name, *sources)], *references)

    runtime, stand_ins = PACKAGE / "Runtime", HERE / "stand_ins"
    unity = ("Puppetline.Core", "Puppetline.Unity", "UnityEngine")
    editing = (*unity, "UnityEditor", "Puppetline.Editor", "nunit.framework")
    compile_("UnityEngine", stand_ins)
    compile_("Puppetline.Core", runtime / "Core", doc="core")
    compile_("Puppetline.Unity", runtime, "Puppetline.Core", "UnityEngine", doc="unity")
    compile_("Unity.Timeline", stand_ins / "timeline", "UnityEngine")
    compile_("UnityEditor", stand_ins / "editor", "UnityEngine")
    compile_("nunit.framework", stand_ins / "nunit")
    compile_("Puppetline.Timeline", runtime / "Timeline", *unity, "Unity.Timeline", doc="timeline")
    compile_("Puppetline.Editor", PACKAGE / "Editor", *unity, "UnityEditor", doc="editor")
    compile_("Tests", PACKAGE / "Tests", *editing, doc="tests", pattern="**/*.cs")
    compile_("Sample", PACKAGE / "Samples~", *unity, pattern="**/*.cs")
    program("Editing", *editing, "Tests")
    program("Core", "Puppetline.Core")
    program("Sharing", "Puppetline.Core")
    program("Clips", *unity, "Puppetline.Timeline", "Unity.Timeline")
    program("Component", *unity, "Sample", sources=("Skeletons", "Said"))
    program("Posing", *unity, sources=("Skeletons", "Said"))
    program("Naming", *unity)


@pytest.fixture
def start(mono, built, until_end):
    """Start one of the programs with arguments."""
    return lambda name, *arguments: until_end(Program([mono[1], built / f"{name}.exe", *arguments]))


@pytest.fixture(scope="session")
def run_core(mono, built):
    """Run the plain core to its end with arguments and input, and return its output."""

    def run(*arguments, told=""):
        command = [mono[1], built / "Core.exe", *arguments]
        ended = subprocess.run(list(map(str, command)), input=told, capture_output=True, text=True, check=False)
        assert ended.returncode == 0, ended.stderr[:2000]
        assert ended.stderr == ""
        return [json.loads(line) for line in ended.stdout.splitlines()]

    return run


@pytest.fixture(params=["buffer", "texture", "browser"])
def shader(request, tmp_path):
    """Run the vertex shader's arithmetic: rows and vertices in; by slopes, by cofactors, positions before out.

    It is compiled as C++, for either API. The browser has no cofactors.
    """
    if request.param == "browser":
        run = in_browser(request.getfixturevalue("browser"), tmp_path)
    else:
        run = as_program(tmp_path / "shader", [] if request.param == "buffer" else ["-DSHADER_API_GLES3"])
    run.api = "Vulkan" if request.param == "buffer" else "OpenGLES3"
    return run


INCLUDE = f"-I{PACKAGE / 'Runtime' / 'Resources'}"


def as_program(path, api):
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("g++ is not here to compile the shader's arithmetic with")
    source = HERE / "programs" / "shader.cpp"
    subprocess.run([compiler, "-O1", "-Wall", "-Werror", *api, INCLUDE, source, "-o", path], check=True)

    def run(rows, moving, constant):
        parts = (np.int32([len(rows)]), np.float32(rows), np.int32([len(moving)]), moving, constant)
        ended = subprocess.run([path], input=b"".join(map(bytes, parts)), capture_output=True, check=True)
        return np.split(np.frombuffer(ended.stdout, np.float32).reshape(-1, 15), [6, 12], axis=1)

    return run


def in_browser(browser, folder):
    """Compile it for OpenGL ES 3.0, by way of SPIR-V as Unity's compiler for it goes by way of bytecode."""
    for program in ("glslangValidator", "spirv-cross"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not here (Debian: glslang-tools, spirv-cross)")
    spirv, source = folder / "vertex.spv", HERE / "programs" / "feedback.hlsl"
    mapped = ["--auto-map-bindings", "--auto-map-locations", "-DSHADER_API_GLES3=1", INCLUDE]
    command = ["glslangValidator", "-D", "-V", "-S", "vert", "-e", "main", *mapped, "-o", spirv, source]
    compiled = subprocess.run(command, capture_output=True, text=True, check=False)
    assert compiled.returncode == 0, compiled.stdout
    translate = ["spirv-cross", spirv, "--es", "--version", "300", "--stage", "vert"]
    shader = subprocess.run(translate, capture_output=True, text=True, check=True).stdout
    place = {"positionOS": 0, "normalOS": 3, "block": 6, "isolines0": 8, "isolines1": 12}
    place |= {f"slopes{k}": 16 + 4 * k for k in range(4)}

    def run(rows, moving, constant):
        given = {"shader": shader, "place": place, "stride": 32}
        for name, numbers in (("rows", rows), ("vertices", np.hstack([moving, constant]))):
            given[name] = base64.b64encode(np.float32(numbers).tobytes()).decode()
        page = browser.new_page()
        told = page.evaluate((HERE / "programs" / "feedback.js").read_text(), given)
        page.close()
        assert told["error"] == ""
        by_slopes, before = np.split(array(told["values"], columns=9), [6], axis=1)
        return by_slopes, None, before

    return run


UNITY = np.float32([-1, 1, 1])
"""Factors to Unity's axes."""


def cofactor_normals(scene, controls):
    linear = blended(scene, controls)[0][:, :, :3]
    turned = np.einsum("vji,vj->vi", np.linalg.inv(linear), scene.arrays["normals"]) * np.linalg.det(linear)[:, None]
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def array(text, kind=np.float32, columns=None):
    """Decode an array that a program printed in base64."""
    values = np.frombuffer(base64.b64decode(text), kind)
    return values if columns is None else values.reshape(-1, columns)


def assert_equal(vertices, theirs, diagonal, most=1e-6, normals_most=1e-5):
    """Positions agree; so do normals, but for the few vertices where f32 says no more (docs/protocol.md)."""
    assert np.abs(vertices[:, :3] - theirs.positions).max() <= most * diagonal
    off = np.abs(vertices[:, 3:] - theirs.normals).max(axis=1)
    assert off.max() <= 10 * normals_most
    assert np.mean(off > normals_most) <= 1e-3


@pytest.fixture
def show(start, stage):
    """Have a Puppet show the stage's figure; `fields` are its own, and what `Component.cs` has besides."""

    def run(service=stage, **fields):
        told = {"port": service.port, "character": "blob", "interpolationDelay": 0, **fields}
        return start("Component", *(f"{name}={value}" for name, value in told.items()))

    return run


def shown(program, stage, count=10, kind=Kind.VERTICES):
    """Send frames, each when the one before is shown; return (what was said, what Python reads of it) of each."""
    found = []
    for frame in stage.next(count):
        stage.send(frame)
        said = program.until(lambda said, number=frame.sequence: said.get("frame") == number)
        found.append((said, decode(encode(kind, frame, 0)).body))
    return found
