from itertools import pairwise

import pytest

from engine_bridge.client.client import connect
from engine_bridge.service.protocol.payloads import Vertices
from puppetline import clock
from puppetline.errors import ServiceError

from ..service.client import TIMEOUT_SECONDS
from ..service.conftest import free_port, serve_module

__all__ = ["free_port", "serve_module"]


@pytest.fixture(scope="module")
def service(serve_module, limbed_puppet):
    return serve_module("--puppet", limbed_puppet, "--source", "demo:walk?loop")


def test_a_client_lists_characters_reads_their_scene_follows_them_and_sends_requests(service):
    with connect(service.stream, control=service.control, timeout=TIMEOUT_SECONDS) as live:
        (name,) = live.characters()
        scene = live.scene(name)
        count = scene.facts["vertices"]
        shapes = {"controls": (None, 3, 4), "joints": (20, 4), "vertices": (count, 3)}
        for kind, shape in shapes.items():
            frames = [frame for frame, _ in zip(live.follow(name, kind), range(3), strict=False)]
            assert all(before.sequence < after.sequence for before, after in pairwise(frames))
            for frame in frames:
                data = frame.data.positions if isinstance(frame.data, Vertices) else frame.data
                assert data.shape[1:] == shape[1:]
                assert shape[0] in (None, len(data))
        assert live.request("ping") == "pong"
        live.request("mirror", character=name, on=True)
        with pytest.raises(ServiceError) as error:
            live.request("mirror", character="nobody", on=True)
        assert error.value.found == "no character 'nobody'"


def test_a_service_that_is_absent_and_what_it_does_not_have_are_told(given_clock, free_port):
    with connect(f"127.0.0.1:{free_port()}") as live:
        begun = clock.now()
        with pytest.raises(ServiceError) as error:
            live.characters()
        assert clock.now() - begun == pytest.approx(5.0)
        assert error.value.where == live.address
        for ask in (lambda: live.follow("dog", "dances"), lambda: live.follow("a/b"), lambda: live.scene("Drache ü")):
            with pytest.raises(ServiceError):
                ask()
    with pytest.raises(ServiceError) as error:
        live.characters()
    assert error.value.found == "a closed client"


@pytest.mark.parametrize(
    "wrong",
    [{"address": "nonsense"}, {"address": "carrier://pigeon"}, {"address": "ipc:///tmp/x"}, {"token": "x" * 300}],
)
def test_what_cannot_be_connected_to_is_refused(wrong):
    with pytest.raises(ServiceError):
        connect(**wrong)
