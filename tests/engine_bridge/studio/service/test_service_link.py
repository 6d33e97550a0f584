import asyncio
import json
from contextlib import asynccontextmanager

import pytest
import zmq
import zmq.asyncio

from engine_bridge.studio.service.service_link import ServiceLink
from engine_bridge.studio.service.service_process import Reached
from puppetline.errors import ServiceError


class Link(ServiceLink):
    """A link to what a test says."""

    reached = None


@asynccontextmanager
async def service(character):
    """Answer every request as a service with one character does; give its addresses."""
    context = zmq.asyncio.Context()
    socket = context.socket(zmq.ROUTER)
    port = socket.bind_to_random_port("tcp://127.0.0.1")

    async def answer():
        while True:
            client, body = await socket.recv_multipart()
            result = {"characters": [{"name": character}], "status": {"stages": []}}
            await socket.send_multipart(
                [client, json.dumps({"id": json.loads(body)["id"], "ok": True, "result": result}).encode()]
            )

    answering = asyncio.create_task(answer())
    yield Reached(f"tcp://127.0.0.1:{port}", "", None)
    answering.cancel()
    context.destroy(linger=0)


def test_what_a_service_said_of_itself_ends_with_it():
    async def run():
        link = Link()
        async with service("dog") as first, service("cat") as second:
            link.reached = first
            await link.refresh()
            seen = [list(link.described)]
            for reached in (None, second):
                link.reached = reached
                seen.append((list(link.described), link.status))
            await link.refresh()
            seen.append(list(link.described))
            await link.close()
        return seen

    assert asyncio.run(run()) == [["dog"], ([], {}), ([], {}), ["cat"]]


def test_a_request_to_a_service_that_has_ended_fails_and_the_next_service_is_still_asked_for_its_status():
    """The request waits for a connection when another one closes it."""

    async def run():
        link = Link()
        async with service("cat") as second:
            link.reached = Reached("tcp://127.0.0.1:9", "", None)
            waiting = asyncio.create_task(link.request("describe"))
            await asyncio.sleep(0)
            link.reached = second
            await link.request("describe")
            with pytest.raises(ServiceError, match="a service that has ended"):
                await waiting
            await link.refresh()
            ended = link._poller.done()
            await link.close()
        return list(link.described), ended

    assert asyncio.run(run()) == (["cat"], False)
