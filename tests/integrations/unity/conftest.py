"""The package compiled with Mono, and programs that use it: its core alone, or all of it with stand-ins for Unity."""

import base64
import json
import os
import shutil
import subprocess
import threading
import time
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zmq

from engine_bridge.performance.clip import load_timeline, solve
from engine_bridge.performance.rig import load_rig
from engine_bridge.performance.settings import Settings
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.header import FRAME_KINDS, WORDS, Header, Kind, join, topic_field, write_json
from engine_bridge.service.protocol.payloads import decode, encode
from engine_bridge.service.protocol.scene import Scene, StreamedCharacter

from ...engine_bridge.service.conftest import services
from ...waiting import wait_until

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


@pytest.fixture(scope="session", params=["buffer", "texture"])
def shader(request, tmp_path_factory):
    """Run the vertex shader's arithmetic, compiled as C++: rows and vertices in; by slopes, cofactors, before out."""
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("g++ is not here to compile the shader's arithmetic with")
    program = tmp_path_factory.mktemp("shader") / "shader"
    source = HERE / "programs" / "shader.cpp"
    api = ["-DSHADER_API_GLES3"] if request.param == "texture" else []
    include = f"-I{PACKAGE / 'Runtime' / 'Resources'}"
    subprocess.run([compiler, "-O1", "-Wall", "-Werror", *api, include, source, "-o", program], check=True)

    def run(rows, moving, constant):
        parts = (np.int32([len(rows)]), np.float32(rows), np.int32([len(moving)]), moving, constant)
        ended = subprocess.run([program], input=b"".join(map(bytes, parts)), capture_output=True, check=True)
        by_slopes, by_cofactors, before = np.split(np.frombuffer(ended.stdout, np.float32).reshape(-1, 15), [6, 12], 1)
        return by_slopes, by_cofactors, before

    run.api = "OpenGLES3" if request.param == "texture" else "Vulkan"
    return run


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


class Reference:
    """Somebody else who follows the service: the newest frames as Python reads them, by sequence number."""

    MOST = 200

    def __init__(self, address, *topics, token=None, every=1):
        self.frames = {}
        self._scene = Future()
        self._ended = False
        self._arguments = (address, topics, token, every)
        self._thread = threading.Thread(target=self._follow)
        self._thread.start()

    def _follow(self):
        address, topics, token, every = self._arguments
        with zmq.Context() as context, context.socket(zmq.SUB) as socket:
            socket.linger = 0
            if token is not None:
                socket.plain_username, socket.plain_password = b"reference", token.encode()
            for topic in topics:
                socket.subscribe(f"{topic}\0".encode())
            socket.connect(address)
            while not self._ended:
                if socket.poll(50):
                    message = decode(socket.recv())
                    if "/scene/" in message.topic:
                        if not self._scene.done():
                            self._scene.set_result(message.body)
                    elif message.header.sequence % every == 0:
                        self.frames[message.header.sequence] = message
                    while len(self.frames) > self.MOST:
                        del self.frames[min(self.frames)]

    @property
    def scene(self):
        """The scene, as soon as it is there."""
        return self._scene.result(TIMEOUT_SECONDS)

    def close(self):
        self._ended = True
        self._thread.join()


@pytest.fixture
def reference(until_end):
    """Follow topics with libzmq and Python."""
    return lambda *arguments, **more: until_end(Reference(*arguments, **more))


class Stage:
    """A publisher in the service's place, with one character, which sends frames when the test says so."""

    def __init__(self, frames):
        self.character = frames[0].character
        scene = Scene.decode(self.character.scene)
        self.facts, self.arrays = scene.facts, scene.arrays
        self.diagonal = self.facts["diagonal"]
        self.kinds = set()
        """Kinds of frames that are subscribed to."""
        self.sent = {}
        """Sent frames by sequence number."""
        self._frames, self._queue, self._is_asked, self._ended = frames, [], False, False
        self._socket = zmq.Context.instance().socket(zmq.XPUB)
        self._socket.linger = 0
        self.port = self._socket.bind_to_random_port("tcp://127.0.0.1")
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def next(self, count):
        """Return so many frames, evenly spaced, with numbers and times that follow those before."""
        first = len(self.sent) + 1
        picked = [self._frames[k * len(self._frames) // count] for k in range(count)]
        return [replace(each, sequence=first + k, time=(first + k) / 30) for k, each in enumerate(picked)]

    def send(self, *frames):
        """Send frames as soon as somebody has the scene and subscribes to them."""
        self.sent |= {frame.sequence: frame for frame in frames}
        self._queue += frames

    def _serve(self):
        told = 0.0
        while not self._ended:
            if self._socket.poll(10):
                self._take(self._socket.recv())
                told = 0.0
            elif time.monotonic() > told + 1:  # a follower treats silence as a lost connection
                told = time.monotonic()
                listed = [{"name": self.character.name, "kinds": [kind.word for kind in FRAME_KINDS]}]
                self._publish("service/characters", Kind.CHARACTERS, write_json(listed))
            while self._queue and self._is_asked and self.kinds:
                frame = self._queue.pop(0)
                for kind in self.kinds:
                    self._socket.send(encode(kind, frame, 0))

    def _take(self, request):
        name, _, word = request[1:].rstrip(b"\0").decode().partition("/")
        if name == self.character.name and word in WORDS:
            (self.kinds.add if request[0] else self.kinds.discard)(WORDS[word])
        elif request[0] and word.startswith("scene/"):
            self._publish(f"{name}/{word}", Kind.SCENE, self.character.scene)
            self._is_asked = True

    def _publish(self, topic, kind, payload):
        header = Header(kind=kind, length=len(payload), revision=self.character.revision)
        self._socket.send(join(topic_field(topic), header, payload))

    def close(self):
        self._ended = True
        self._thread.join()
        self._socket.close()


@pytest.fixture
def new_stage(until_end):
    """Make publishers of frames."""
    return lambda frames: until_end(Stage(frames))


def performed(puppet, take):
    """The frames of a take."""
    rig, settings = load_rig(puppet), Settings()
    timeline, _ = load_timeline(take, settings)
    (poses,) = solve(rig, timeline, settings, 1000)
    character, handles = StreamedCharacter.of(puppet.stem, rig), rig.puppet.handle_positions
    return [
        Frame(character, k + 1, k / 30, 0, "performing", 1, np.float64(R), root, handles, motions=motions)
        for k, (R, root, motions) in enumerate(zip(*poses, strict=True))
    ]


@pytest.fixture(scope="session")
def danced(blob_puppet, take):
    return performed(blob_puppet, take)


@pytest.fixture
def stage(new_stage, danced):
    """The small figure's frames."""
    return new_stage(danced)


@pytest.fixture(scope="session")
def baked(blob_puppet, take, commands, tmp_path_factory):
    """The small figure's morph targets."""
    path = tmp_path_factory.mktemp("baked") / "blob.morphs.glb"
    commands.run("bake", blob_puppet, "-o", path, "--log", take, "--tolerance", "0.002").check_returncode()
    return path


@pytest.fixture(scope="session")
def played(blob_puppet, take):
    """Arguments that have the small figure moved by a take again and again."""
    return ("--puppet", blob_puppet, "--source", f"replay:{take}?loop", "--calibrate", "at_once")


@pytest.fixture
def serve_figure(serve, played, free_port):
    """Serve the small figure, for this test alone."""

    def start(*arguments, port=None):
        port = port or free_port()
        return serve(*played, "--port", port, *arguments)

    return start


@pytest.fixture
def serve_puppet(serve, free_port):
    """Serve a puppet that a take moves again and again."""

    def start(puppet, take, *arguments):
        played = ("--puppet", puppet, "--source", f"replay:{take}?loop", "--calibrate", "at_once")
        return serve(*played, "--port", free_port(), *arguments)

    return start


@pytest.fixture(scope="session")
def figure(own_cache, commands, played, baked, tmp_path_factory):
    """The small figure, served as long as the tests run, with morph targets; none asks for what others would see."""
    with services(commands, tmp_path_factory.mktemp("figure")) as start:
        yield start(*played, "--morphs", baked)


@pytest.fixture(scope="session")
def locked_figure(own_cache, commands, played, token_file, tmp_path_factory):
    """The same behind a token, without morph targets."""
    with services(commands, tmp_path_factory.mktemp("locked")) as start:
        yield start(*played, "--token-file", token_file)


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


@pytest.fixture
def python(reference, figure):
    return reference(figure.stream, "blob/vertices", "blob/scene/python")


def shown_live(program, reference, wanted=20, since=0):
    """Wait until so many moments were shown that the reference has too; return (what was said, reference) of each."""

    def both():
        theirs = dict(reference.frames)
        found = [(each, theirs[each["frame"]].body) for each in program.said[since:] if each.get("frame") in theirs]
        return found if len(found) >= wanted else None

    return wait_until(both)
