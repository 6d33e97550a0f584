"""The example client of the wire protocol, given the recorded messages over a real socket."""

import struct
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import zmq
from scipy.spatial.transform import Rotation

from engine_bridge.export.live_basis import REACH
from engine_bridge.export.unit_weights import UnitWeights
from solver.model.binding import Binding
from solver.motion.deformer import Deformer, to_file_units

from ..engine_bridge.conftest import Glb
from ..modules import load
from ..recorded import EXPECTED, VECTORS

SCENE = EXPECTED["scene"]["facts"]
MODES = ("controls", "morphs", "vertices")
TOLD = ("sequence", "time", "state", "user", "received", "published")
TIMEOUT_SECONDS = 20.0


client = load("examples/clients/follow.py")
morph_targets = load("examples/clients/morph_targets.py")


def recorded(name, **header):
    """Return a recorded message, with other numbers in its header."""
    message = bytearray((VECTORS / f"{name}.bin").read_bytes())
    for field, value in header.items():
        struct.pack_into(*{"major": ("B", message, 64), "revision": ("<I", message, 72)}[field], value)
    return bytes(message)


def told(name):
    """Return what the header says of the moment."""
    return {field: EXPECTED[name]["header"][field] for field in TOLD}


def solved(number):
    """Return positions and normals of a frame as the service has them."""
    return np.frombuffer(recorded(f"{number}.vertices")[128:], "<f4").reshape(2, -1, 3)


class Service:
    """Who the client talks to: says what a test has it say."""

    def __init__(self, context):
        self._socket = context.socket(zmq.XPUB)
        self._socket.linger = 0
        self._port = self._socket.bind_to_random_port("tcp://127.0.0.1")
        self._pool = ThreadPoolExecutor(1)
        self._scene = None

    def begin(self, mode, targets=None):
        """Let a client subscribe and wait for its first frame."""
        self._frames = client.follow(f"tcp://127.0.0.1:{self._port}", "worm", mode, targets=targets)
        self.wait()
        asked = {self.asked(), self.asked()}
        [scene] = asked - {f"+worm/{mode}"}
        assert scene.startswith("+worm/scene/")
        self._scene = scene[1:]

    def wait(self):
        """Let the client wait for its next frame."""
        self._next = self._pool.submit(next, self._frames)

    def shown(self):
        """Return the frame for which the client has waited."""
        return self._next.result(TIMEOUT_SECONDS)

    def error(self):
        return self._next.exception(TIMEOUT_SECONDS)

    def asked(self):
        """Return what is subscribed to next or, with a minus, no longer."""
        assert self._socket.poll(1000 * TIMEOUT_SECONDS)
        request = self._socket.recv()
        assert request[-1:] == b"\0"
        return "-+"[request[0]] + request[1:-1].decode()

    def asked_for_the_scene(self):
        return (self.asked(), self.asked()) == (f"-{self._scene}", f"+{self._scene}")

    def send(self, *messages):
        for message in messages:
            self._socket.send(message)

    def show_first(self, mode, name):
        """Let a client show a recorded message after the scene, and wait for the next."""
        self.begin(mode)
        self.send_scene()
        self.send(recorded(name))
        self.shown()
        self.wait()

    def send_scene(self, revision=7, length=None):
        message = recorded("scene", revision=revision).replace(b'"revision":7', b'"revision":%d' % revision)
        self._socket.send((self._scene.encode().ljust(64, b"\0") + message[64:])[:length])

    def close(self):
        for mode in MODES:
            self.send(recorded(f"0.{mode}", major=9))  # which ends a client that still waits
        self._pool.shutdown()
        self._frames.close()
        self._socket.close()


@pytest.fixture
def service():
    with zmq.Context() as context:
        made = Service(context)
        yield made
        made.close()


@pytest.fixture(scope="module")
def worms_targets():
    """Displacements of the worm's vertices by the targets of the recorded morphs."""
    record = load("tests/vectors/record.py")
    prepared = record.worm()
    deformer = Deformer(prepared.model, prepared.mesh, prepared.puppet.handle_positions)
    binding = Binding(prepared.model, prepared.character.vertices, prepared.mesh.of_render)
    rest, first, _, second = (
        binding.vertices(to_file_units(deformer.solve(deformer.handles + pull), prepared.model))
        for pull in (*record.PULLS, record.IN_BETWEEN)
    )
    return UnitWeights.within(np.full(2, REACH)).targets(np.stack([first, second]) - rest)


def test_targets_are_read_in_the_order_of_the_scene_whatever_the_transforms_above_them(tmp_path):
    """The first target of each mesh is one of its own."""
    above, turn = np.array([[0.0, 2, 0], [-1, 0, 0], [0, 0, 3]]), Rotation.from_rotvec([0.3, -1.1, 0.7])
    glb, matrix, expected = Glb(), np.eye(4), []
    matrix[:3, :3] = above
    glb.file.asset.extras = {"puppetline_morphs": {"lengths": [1.0, 1.0]}}
    parent = glb.node(matrix=matrix.T.ravel().tolist())
    turned = {"rotation": turn.as_quat().tolist(), "scale": [1.5, 1, 0.5]}
    for linear, how in ((above @ turn.as_matrix() * [1.5, 1, 0.5], turned), (above, {})):
        stored = np.random.default_rng(len(how)).normal(size=(3, 4, 3)).astype(np.float32)
        surface = glb.primitive(np.eye(4, 3), targets=[{"POSITION": target} for target in stored])
        glb.node(glb.mesh(surface), parent, **how)
        expected.insert(0, stored[1:] @ linear.T)
    glb.file.nodes[parent].children.reverse()
    targets = morph_targets.read_targets(glb.save(tmp_path / "baked.glb"))
    np.testing.assert_allclose(targets, np.concatenate(expected, axis=1), atol=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_the_recorded_frames_are_shown_and_morphs_leave_of_them_what_their_residual_says(service, worms_targets, mode):
    service.begin(mode, worms_targets if mode == "morphs" else None)
    service.send_scene()
    for number in range(3):
        service.send(recorded(f"{number}.{mode}"))
        header, positions, normals = service.shown()
        service.wait()
        assert {name: getattr(header, name) for name in TOLD} == told(f"{number}.{mode}")
        away = (positions - solved(number)[0]) / SCENE["diagonal"]
        if mode == "morphs":
            residual = np.sqrt(np.mean(np.sum(away**2, axis=1)))
            assert (normals, residual) == (None, pytest.approx(EXPECTED[f"{number}.morphs"]["residual"], abs=1e-6))
        else:
            np.testing.assert_allclose(away, 0, atol=1e-5)
            np.testing.assert_allclose(normals, solved(number)[1], rtol=0, atol=1e-5)


def test_of_what_has_piled_up_the_newest_of_each_topic_is_read():
    with zmq.Context() as context, context.socket(zmq.PAIR) as sender, context.socket(zmq.PAIR) as receiver:
        sender.bind("inproc://pile")
        receiver.connect("inproc://pile")
        frames = [recorded(f"{number}.controls") for number in range(3)]
        for message in (frames[0], recorded("scene"), frames[1], frames[2], recorded("1.vertices")):
            sender.send(message)
        assert client.newest(receiver) == [recorded("scene"), frames[2], recorded("1.vertices")]
        assert client.newest(receiver) == []


def test_frames_of_another_revision_are_dropped_until_their_scene_has_come(service):
    service.show_first("controls", "0.controls")
    service.send(recorded("1.controls", revision=8))
    assert service.asked_for_the_scene()
    service.send_scene(revision=8)
    service.send(recorded("2.controls", revision=8))
    header, positions, _ = service.shown()
    assert (header.sequence, header.revision) == (43, 8)
    np.testing.assert_allclose(positions, solved(2)[0], rtol=0, atol=1e-5 * SCENE["diagonal"])


def test_without_a_scene_or_after_a_new_start_of_the_service_it_shows_nothing_and_asks_again(service):
    service.begin("controls")
    service.send(recorded("1.controls"))
    assert service.asked_for_the_scene()
    assert service.asked_for_the_scene()
    service.send_scene()
    service.send(recorded("1.controls"))
    assert service.shown()[0].sequence == 42
    service.wait()
    service.send(recorded("0.controls"))
    assert service.asked_for_the_scene()
    service.send_scene()
    service.send(recorded("0.controls"))
    assert service.shown()[0].sequence == 41


@pytest.mark.parametrize("mode", ["controls", "vertices"])
def test_scenes_and_frames_that_are_cut_short_are_passed_over(service, mode):
    service.show_first(mode, f"0.{mode}")
    for length in (64, 65, 127, 128, 131, 1000, 19003):
        service.send_scene(length=length)
    for number, length in enumerate((64, 100, 127, 128, 130, 132, 1000), 1):
        message = recorded(f"0.{mode}")[:length]
        service.send(message[:63] + bytes([number]) + message[64:])  # with one topic, each would replace the one before
    service.send(recorded(f"1.{mode}"))
    assert service.shown()[0].sequence == 42


def test_a_message_of_another_version_is_refused(service):
    service.begin("controls")
    service.send(recorded("0.controls", major=2))
    error = service.error()
    assert isinstance(error, RuntimeError)
    assert "version 2" in str(error)
