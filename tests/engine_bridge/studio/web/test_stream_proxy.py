import asyncio

from engine_bridge.studio.web.stream_proxy import _Newest


def message(topic, content):
    return topic.encode().ljust(64, b"\0") + content


def test_the_newest_message_of_each_topic_waits_for_a_slow_page():
    async def run():
        newest = _Newest()
        for k in range(1000):
            newest.put(message("dog/controls", b"%d" % k))
            newest.put(message("cat/controls", b"%d" % k))
            newest.put(f"reply {k}")
        newest.end()
        taken = []
        while (each := await newest.take()) is not None:
            taken.append(each)
        return taken

    taken = asyncio.run(run())
    assert taken[:256] == [f"reply {k}" for k in range(744, 1000)]
    assert taken[256:] == [message("dog/controls", b"999"), message("cat/controls", b"999")]
