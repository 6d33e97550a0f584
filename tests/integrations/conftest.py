"""The service that engines talk to, as its own tests start it: the real process, on free ports, with a small figure."""

import socket
import struct
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import make_character
from engine_bridge.character.examples import prepare
from engine_bridge.performance.exercise import random_poses
from engine_bridge.performance.prepared_character import load_prepared, make_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.service.clip_export import write_clip
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.header import Header, Kind, join, topic
from engine_bridge.service.protocol.payloads import encode
from engine_bridge.service.protocol.scene import StreamedCharacter

for shared in ("clips", "limbs", "messages", "playback", "requests", "surface"):
    pytest.register_assert_rewrite(f"{__package__}.{shared}")

from ..engine_bridge import conftest as figures  # noqa: E402
from ..engine_bridge.service import conftest as services  # noqa: E402
from ..engine_bridge.service.outputs.frames import pose_of  # noqa: E402
from .stage import Stage, performed  # noqa: E402

own_cache, glb, new_glb = figures.own_cache, figures.glb, figures.new_glb
talking, limb_tables = figures.talking, figures.limb_tables
make_shape, blob, blob_file, write_puppet, blob_puppet, prepared_blob, limbed_puppet = (
    figures.make_shape,
    figures.blob,
    figures.blob_file,
    figures.write_puppet,
    figures.blob_puppet,
    figures.prepared_blob,
    figures.limbed_puppet,
)
standing, dance, frames = figures.standing, figures.dance, figures.frames
record_events, record, take = figures.record_events, figures.record, figures.take
serve, serve_module, listen = services.serve, services.serve_module, services.listen
sender, free_port, kung_fu = services.sender, services.free_port, services.kung_fu


@pytest.fixture(scope="session")
def token_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("token") / "token"
    path.write_text("correct-horse-battery-staple")
    path.chmod(0o600)
    return path


@pytest.fixture(scope="session")
def clip(take: Path, blob_puppet: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The figure moved by the take, in a clip file."""
    path = tmp_path_factory.mktemp("clips") / "dance.clip"
    write_clip(take, blob_puppet, path, "dancer", Settings())
    return path


@pytest.fixture
def new_stage(until_end):
    """Make publishers of frames."""
    return lambda frames: until_end(Stage(frames))


@pytest.fixture(scope="session")
def danced(blob_puppet, take):
    """The small figure's frames."""
    return performed(blob_puppet, take)


@pytest.fixture(scope="session")
def solved(danced):
    """The vertices (F, N, 3) of these frames, and the diagonal."""
    return np.array([frame.vertices_and_normals[0] for frame in danced]), danced[0].character.prepared.mesh.diagonal


@pytest.fixture
def stage(new_stage, danced):
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
    """Serve the small figure, for this test alone; control sockets have the port after the stream's."""

    def start(*arguments, port=None):
        return serve(*played, "--port", port or free_port(), *arguments)

    return start


@pytest.fixture(scope="module")
def figure(own_cache, commands, played, baked, tmp_path_factory):
    """The small figure with morph targets, served for a module: one that runs to the end takes a tenth of a core."""
    with services.services(commands, tmp_path_factory.mktemp("figure")) as start:
        yield start(*played, "--morphs", baked)


@pytest.fixture(scope="module")
def locked_figure(own_cache, commands, played, token_file, tmp_path_factory):
    """The same behind a token, without morph targets."""
    with services.services(commands, tmp_path_factory.mktemp("locked")) as start:
        yield start(*played, "--token-file", token_file)


@pytest.fixture(scope="session")
def human(tmp_path_factory):
    """The example human, turned by 30° to its left."""
    _, path = prepare("human", tmp_path_factory.mktemp("example"))
    straight, turn = load_prepared(path), Rotation.from_rotvec([0, 30, 0], degrees=True)
    mesh, puppet = straight.character, straight.puppet
    limbs = [limb.model_copy(update={"points": tuple(map(tuple, turn.apply(limb.points)))}) for limb in puppet.limb]
    turned = {"limb": tuple(limbs), "character": puppet.character.model_copy(update={"turn": 30.0})}
    character = make_character("human", turn.apply(mesh.vertices), mesh.triangles)
    return StreamedCharacter.of("figure", make_prepared(puppet.model_copy(update=turned), character))


@pytest.fixture(scope="session")
def posed_human(human):
    """A frame in a random pose."""
    controls, motions = random_poses(human.prepared, 3)
    R, root = controls[-1].astype(np.float64), np.array([0.3, 0.1, 0.2])
    return Frame(human, 1, 0.5, 0, "performing", 0, pose_of(human.prepared, R=R, root=root, bones=motions[-1]))


@pytest.fixture
def spoken(talking):
    """Frames of a figure whose mesh has a target "jaw": silent, and in two poses in which it speaks."""
    character = StreamedCharacter.of("talker", load_prepared(talking(limbs=True)))
    controls, motions = random_poses(character.prepared, 3)
    poses = [
        pose_of(
            character.prepared,
            R=controls[number].astype(np.float64),
            root=np.array([0.1 * number, 0, 0]),
            bones=motions[number],
            channels={"voice": voice},
        )
        for number, voice in enumerate((0.0, 0.4, 1.0))
    ]
    return [Frame(character, k + 1, k / 30, 0, "performing", 0, pose) for k, pose in enumerate(poses)]


@pytest.fixture
def spoken_files(spoken, tmp_path):
    """Write the messages of a kind of these frames to files, with a name; the first file is the scene."""

    def write(kind):
        character = spoken[0].character
        header = Header(kind=Kind.SCENE, length=len(character.scene), revision=character.revision)
        messages = [
            join(topic("talker", Kind.SCENE), header, character.scene),
            *(encode(kind, each, 0) for each in spoken),
        ]
        files = [tmp_path / f"talker.{kind.word}.{number}" for number in range(len(messages))]
        for file, content in zip(files, messages, strict=True):
            file.write_bytes(content)
        return files

    return write


@pytest.fixture
def packed(tmp_path):
    """Write messages to a file, each after its length in 4 bytes, as the clients' programs read them."""

    def write(messages):
        path = tmp_path / "messages"
        path.write_bytes(b"".join(struct.pack("<I", len(message)) + message for message in messages))
        return path

    return write


class Line:
    """A line to a port that cuts everything into pieces, and can be torn."""

    def __init__(self, port, piece=1):
        self._piece = piece
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._to = port
        self._open = []
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        with suppress(OSError):
            while True:
                ends = self._listener.accept()[0], socket.create_connection(("127.0.0.1", self._to))
                self._open += ends
                for source, sink in (ends, ends[::-1]):
                    sink.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    threading.Thread(target=self._pass, args=(source, sink), daemon=True).start()

    def _pass(self, source, sink):
        with suppress(OSError):
            while data := source.recv(1 << 16):
                for k in range(0, len(data), self._piece):
                    sink.sendall(data[k : k + self._piece])

    def tear(self):
        for each in self._open:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
        self._open.clear()

    def close(self):
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.tear()


@pytest.fixture
def line(until_end):
    return lambda port, piece=1: until_end(Line(port, piece))


class Server:
    """Something in the service's place that answers one connection after the other with a function of the test."""

    def __init__(self, answer, port=0):
        self._answer = answer
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._accept)
        self._thread.start()

    def _accept(self):
        with suppress(OSError):
            while True:
                with self._listener.accept()[0] as line, suppress(OSError):
                    self._answer(line)

    def close(self):
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)  # wakes who waits for somebody to come
        self._listener.close()
        self._thread.join()


@pytest.fixture
def answering(until_end):
    """Start a server that answers with a function, at a port or at any."""
    return lambda answer, port=0: until_end(Server(answer, port))
