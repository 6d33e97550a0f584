"""The JavaScript client in a real browser, with real services."""

from pathlib import Path

import pytest

from ...waiting import wait_until

pytestmark = pytest.mark.slow

CONNECT = """([address, token]) => {
  window.states = [];
  window.client = new puppetline.Client(address, { token });
  client.addEventListener("state", () => states.push(client.state));
}"""

COUNT = """() => {
  window.come = 0;
  window.WebSocket = class extends WebSocket {
    constructor(...given) {
      super(...given);
      this.addEventListener("message", ({ data }) => {
        come += data instanceof ArrayBuffer && new TextDecoder().decode(data.slice(0, 13)) === "blob/controls";
      });
    }
  };
}"""
"""Count the frames that come through the socket."""

CONNECTED = "() => client.state === 'connected'"


WALKING = ("--source", "demo:walk?loop", "--calibrate", "at_once")


@pytest.fixture
def start(serve_page, blob_puppet):
    """Start a service with one character, at free ports or at given ones."""
    return lambda *more, **ports: serve_page("--puppet", blob_puppet, *WALKING, *more, **ports)


@pytest.fixture(scope="module")
def shared(serve_module, blob_puppet, site):
    """A service that tests do not change, and the address of its WebSocket."""
    service = serve_module("--puppet", blob_puppet, *WALKING, "--websocket", 0, "--origin", site.origin)
    return service, service.logged("serving")["fields"]["stream"][-1]


def test_requests_are_answered_with_their_results_or_with_the_errors_of_the_service(shared, open_page):
    _, address = shared
    page = open_page()
    page.run(CONNECT, [address, None])
    page.until(CONNECTED)
    assert page.run("() => Promise.all([1, 2, 3].map(() => client.request({ do: 'ping' })))") == ["pong"] * 3
    assert page.run("() => client.request({ do: 'list' })")["characters"] == ["blob"]
    failed = page.run(
        "() => client.request({ do: 'mirror', character: 'cat', on: true }).catch((error) => ({ ...error }))"
    )
    assert failed == {
        "where": "the request, character",
        "found": "no character 'cat'",
        "expected": "one of blob",
        "fix": "Choose one of these.",
    }


def test_listeners_of_a_topic_share_a_subscription_and_late_ones_get_the_last_message(start, open_page):
    service, address = start()
    page = open_page()
    page.run(COUNT)
    page.run(CONNECT, [address, None])
    page.run(
        """() => {
          window.heard = { one: [], two: [], frames: 0 };
          client.subscribe("service/characters", (message) => heard.one.push(message.body[0].name));
          window.ends = [1, 2].map(() => client.subscribe("blob/controls", () => heard.frames++));
        }"""
    )
    page.until("() => heard.frames > 10 && heard.one.length")
    page.run('() => { client.subscribe("service/characters", (message) => heard.two.push(message.body[0].name)); }')
    page.until("() => heard.two.length")
    assert page.run("() => heard.two") == page.run("() => heard.one") == ["blob"]
    before = page.run("() => { ends.forEach((end) => end()); return heard.frames; }")
    page.run("() => client.request({ do: 'ping' })")
    last, other = page.run("() => come"), service.client("blob/controls")
    assert 2 * last >= before > 0  # two listeners
    first = other.until(lambda _: True)[0].header.sequence
    other.until(lambda message: message.header.sequence > first + 10)
    page.run("() => client.request({ do: 'ping' })")
    assert page.run("() => [come, heard.frames]") == [last, before]
    wait_until(lambda: service.ask("describe")["status"]["outputs"][-1]["clients"] == 1)  # counted once per second


def test_a_wrong_token_is_final_until_retry_and_the_right_one_is_accepted(start, open_page, token_file):
    _, address = start("--token-file", token_file)
    page = open_page()
    page.page.clock.install()
    page.run(CONNECT, [address, "wrong-wrong-wrong-wrong"])
    page.until("() => client.state === 'refused'")
    page.page.clock.fast_forward(60_000)
    assert page.run("() => states") == ["refused"]
    page.run("(token) => { client.token = token; client.retry(); }", token_file.read_text())
    page.until(CONNECTED)
    assert page.run("() => states") == ["refused", "connecting", "connected"]


def test_a_killed_service_that_starts_again_is_followed_again(start, open_page, free_port):
    ports = free_port(), free_port()
    first, address = start("--port", ports[0], port=ports[1])
    page = open_page()
    page.run(CONNECT, [address, None])
    page.run(
        """() => {
          window.character = new puppetline.Character(client, "blob");
          window.scenes = window.frames = 0;
          character.addEventListener("scene", () => scenes++);
          character.addEventListener("frame", () => frames++);
        }"""
    )
    page.until("() => frames > 30")
    page.run("() => { character.pause(); character.pause(); }")
    still = page.run("() => frames")
    for _ in range(3):
        page.run("() => client.request({ do: 'ping' })")
    assert page.run("() => [frames, character.frame !== null]") == [still, True]
    page.run("() => { character.resume(); character.resume(); }")
    page.until(f"() => frames > {still} + 30")
    first.process.kill()
    page.until("() => client.state === 'offline'")
    lost = page.run("() => client.request({ do: 'ping' }).catch((error) => error.message)")
    assert f"{address}: found No Puppetline service at {address}." in lost
    start("--port", ports[0], port=ports[1])
    page.until(CONNECTED)
    before = page.run("() => frames")
    page.until(f"() => frames > {before} + 30")
    assert page.run("() => scenes") == 1  # the same scene, which need not be made again
    assert page.run("() => states")[-2:] == ["offline", "connected"]
    page.run("() => { character.close(); client.close(); }")
    assert page.run("() => client.state") == "closed"


def test_a_reloaded_character_gets_its_new_scene(start, open_page, blob_puppet):
    service, address = start()
    page = open_page()
    page.run(CONNECT, [address, None])
    page.run(
        """() => {
          window.character = new puppetline.Character(client, "blob");
          window.revisions = [];
          character.addEventListener("scene", () => revisions.push(character.scene.description.revision));
        }"""
    )
    page.until("() => character.frame")
    text = blob_puppet.read_text()
    try:
        blob_puppet.write_text(text.replace('name = "head"', 'name = "nose"'))
        assert service.ask("reload") == {"characters": ["blob"]}
        page.until("() => revisions.length === 2 && character.frame?.header.revision === revisions[1]")
        handles = page.run("() => character.scene.description.handles.map((handle) => handle.name)")
        assert "nose" in handles
    finally:
        blob_puppet.write_text(text)


def test_a_page_that_was_frozen_continues_with_new_frames(shared, open_page):
    _, address = shared
    count = """([address]) => {
      window.client = new puppetline.Client(address);
      window.numbers = [];
      client.subscribe("blob/controls", (message) => numbers.push(message.header.sequence));
      client.subscribe("blob/vertices", () => {});
    }"""
    other, frozen = open_page(), open_page()
    for page in (other, frozen):
        page.run(count, [address])
        page.until("() => numbers.length > 10")
    debugger = frozen.page.context.new_cdp_session(frozen.page)
    for command in ("enable", "pause"):
        debugger.send(f"Debugger.{command}")
    newest = other.run("() => numbers.at(-1)") + 100
    other.until(f"() => numbers.at(-1) > {newest}")
    debugger.send("Debugger.resume")
    frozen.until(f"() => numbers.at(-1) > {newest}")
    for page in (other, frozen):
        numbers = page.run("() => numbers")
        assert numbers == sorted(set(numbers))


def test_the_example_page_shows_a_character(shared, open_page):
    _, address = shared
    page = open_page(f"/example.html?service={address}&character=blob")
    page.page.wait_for_function("document.getElementById('status').textContent === ''")

    def is_shown():
        picture = page.picture().astype(int)
        return 0.02 < (abs(picture - picture[0, 0]).max(axis=2) > 12).mean() < 0.6

    wait_until(is_shown)


def test_the_ten_lines_of_the_documentation_show_a_character(shared, open_page, site, tmp_path):
    document = (Path(__file__).parents[3] / "docs" / "web.md").read_text(encoding="utf-8")
    program = document.partition("```js\n")[2].partition("```")[0]
    assert len([line for line in program.splitlines() if line]) == 10
    _, address = shared
    page = tmp_path / "ten.html"
    mine = program.replace("ws://127.0.0.1:7402/stream", address).replace('"dog"', '"blob"').replace('"./', '"/')
    template = (Path(__file__).parent / "page.html").read_text(encoding="utf-8")
    page.write_text(template.replace('src="page.js">', f">{mine}"), encoding="utf-8")
    shown = open_page(site.add(page))
    wait_until(lambda: (abs(shown.picture()[:150, :300].astype(int)).max(axis=2) > 30).mean() >= 0.02)
