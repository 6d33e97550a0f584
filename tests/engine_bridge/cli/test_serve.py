"""The live service, and the commands that are used with it."""

import json
import os
import socket
import stat
import subprocess
import sys

import pytest
from click.testing import CliRunner

from capture.formats import read_log
from engine_bridge.cli.main import main

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["serve"], "Give --puppet or --config."),
        (["serve", "--config", "a.toml", "--puppet", "b.toml"], "--config cannot be combined with --puppet:"),
        (["serve", "--config", "a.toml", "--loop", "--port", "0"], "--config cannot be combined with --loop, --port:"),
        (["serve", "--config", "a.toml", "--no-announce"], "combined with --announce/--no-announce:"),
        (["serve", "--puppet", "a.toml", "--osc", "nowhere"], "--osc requires HOST:PORT"),
        (["serve", "--puppet", "a.toml", "--port", "70000"], "70000"),
        (["serve", "--puppet", "a.toml", "--people", "all"], "'all'"),
        (["serve", "--puppet", "a.toml", "--origin", "http://localhost:8000"], "--origin requires --websocket."),
        (["serve", "--puppet", "a.toml", "--websocket", "65536"], "65536"),
        (["record", "--source", "osc:1"], "Missing option '-o'"),
        (["look", "--source", "osc:1"], "Give -o, --live, or both."),
        (["look", "--source", "osc:1", "--live"], "--live requires a terminal"),
        (["listen", "--seconds", "nan"], "not a finite number"),
    ],
)
def test_wrong_use_is_reported(arguments, message):
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert message in result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--source", "replay:none.log"], "none.log"),
        (["--source", "osc:0", "--idle", "none.log"], "none.log"),
        (["--source", "osc:0", "--morphs", "none.glb"], "none.glb"),
        (["--source", "osc:0", "--host", "192.0.2.1"], "192.0.2.1"),
        (["--source", "osc:0", "--token-file", "none"], "none"),
        (["--source", "osc:0", "--source", "osc:0"], "2 times --source and 1 times --puppet"),
        (["--source", "osc:0", "--osc", "no.such.host.invalid:7000"], "no.such.host.invalid"),
    ],
)
def test_settings_that_cannot_be_served_give_one_line_and_exit_code_1(run, blob_puppet, arguments, message):
    result = run("serve", "--puppet", blob_puppet, "--port", 0, "--no-announce", *arguments, code=1)
    lines = [line for line in result.stderr.splitlines() if line.startswith("puppetline: ")]
    assert len(lines) == 1
    assert message in lines[0]
    assert "Traceback" not in result.stderr
    assert "internal error" not in result.stderr


def test_a_port_that_is_taken_is_one_line(run, serve, blob_puppet):
    port = serve("--puppet", blob_puppet, "--source", "osc:0").port
    result = run("serve", "--puppet", blob_puppet, "--source", "osc:0", "--port", port, "--no-announce", code=1)
    assert f"addresses that cannot be bound: tcp://127.0.0.1:{port}" in result.stderr


def test_listen_reports_what_arrives(run, serve, blob_puppet):
    service = serve("--puppet", blob_puppet, "--source", "demo:walk?loop")
    address = service.stream.removeprefix("tcp://")
    kinds = ("--kind", "controls", "--kind", "handles")
    report = json.loads(run("listen", address, "--seconds", 2, "--json", *kinds).stdout)
    heard = {each["topic"]: each for each in report["heard"]}
    assert heard["blob/controls"]["missing"] == 0
    assert heard["blob/controls"]["latency_ms"]["p50"] > 0
    assert 20 < heard["blob/handles"]["rate"] < 40
    assert "blob/controls" in run("listen", address, "--seconds", 1).stdout
    assert "expected a running service" in run("listen", "127.0.0.1:1", "--seconds", 0.3, code=1).stderr


def test_record_writes_a_take_that_can_be_read_and_is_not_overwritten(run, sender, kung_fu, tmp_path):
    with sender.playing(kung_fu[:30]):
        summary = json.loads(run("record", "--source", sender.uri, "-o", "take.log", "--seconds", 2, "--json").stdout)
    [clip] = read_log(tmp_path / "take.log")
    assert len(clip.times) == summary["frames"] > 20
    assert (summary["users"], summary["ended"]) == ([1], "time")
    assert "replace it with --force" in run("record", "--source", "osc:0", "-o", "take.log", code=1).stderr


def test_a_token_and_keys_are_for_their_owner_alone(run, tmp_path):
    run("token", "secret")
    run("keys", "kiosk.key_secret")
    for name in ("secret", "kiosk.key_secret"):
        assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o600
    assert (tmp_path / "kiosk.key").exists()
    run("token", "secret", code=1)


def test_bake_makes_a_file_that_serve_plays(run, serve, blob_puppet, tmp_path):
    summary = json.loads(run("bake", blob_puppet, "-o", "blob.morphs.glb", "--targets", 8, "--json").stdout)
    service = serve("--puppet", blob_puppet, "--source", "demo:walk?loop", "--morphs", tmp_path / "blob.morphs.glb")
    client = service.client("blob/morphs")
    frames = client.until(lambda message: message.header.state == 2 and message.header.sequence % 40 == 0, "morphs")
    assert {frame.body.weights.shape for frame in frames} == {(summary["targets"],)}
    assert 0 < frames[-1].body.residual < 0.05
    assert service.ask("describe")["characters"][0]["morphs"] == [f"motion_{k}" for k in range(summary["targets"])]


def test_demo_live_streams_the_examples(tmp_path, run, commands):
    with socket.socket() as port:
        if port.connect_ex(("127.0.0.1", 7400)) == 0:
            pytest.skip("somebody has the default port")
    process = commands.start(
        *("demo", "dog", "--live", "-o", tmp_path),
        stderr=subprocess.PIPE,
        env=os.environ | {"XDG_STATE_HOME": str(tmp_path / "state")},
    )
    try:
        line = next(line for line in process.stderr if "serving" in line)
        assert "tcp://127.0.0.1:7400" in line
        report = json.loads(run("listen", "--seconds", 1, "--json").stdout)
        assert [each["topic"] for each in report["heard"]] == ["dog/controls"]
    finally:
        process.terminate()
        assert process.wait(10) == 0
        process.stderr.close()


def test_a_restarted_service_does_not_wait_for_what_it_does_not_need():
    heavy = ("scipy.linalg", "scipy.spatial", "scipy.sparse.linalg", "zeroconf", "prometheus_client")
    program = f"import sys, engine_bridge.service.service; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
