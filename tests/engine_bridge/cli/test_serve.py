"""The live service, and the commands that are used with it."""

import json
import os
import socket
import stat
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow


def test_a_port_that_is_taken_is_one_line(assert_refused, blob_puppet):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        arguments = ("serve", "--puppet", blob_puppet, "--source", "osc:0", "--port", port, "--no-announce")
        assert_refused(*arguments, parts=[f"tcp://127.0.0.1:{port}"])


def test_a_token_and_keys_are_for_their_owner_alone(invoke, tmp_path):
    for command, name in (("token", "secret"), ("keys", "kiosk.key_secret")):
        invoke(command, name)
        assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o600
        invoke(command, name, code=1)


def test_bake_makes_a_file_that_serve_plays(invoke, play, blob_puppet):
    summary = json.loads(invoke("bake", blob_puppet, "-o", "blob.morphs.glb", "--targets", 8, "--json").stdout)
    service = play("--puppet", blob_puppet, "--source", "demo:walk?loop", "--morphs", "blob.morphs.glb")
    service.until(lambda: service.frames and service.frames[-1].state == "performing")
    service.run(1.0)
    assert {frame.morphs.weights.shape for frame in service.frames} == {(summary["targets"],)}
    assert 0 < service.frames[-1].morphs.residual < 0.05
    assert service.ask("describe")["characters"][0]["morphs"] == [f"motion_{k}" for k in range(summary["targets"])]


def test_demo_live_streams_the_examples_and_listen_reports_them(tmp_path, invoke, commands):
    with socket.socket() as port:
        if port.connect_ex(("127.0.0.1", 7400)) == 0:
            pytest.skip("somebody has the default port")
    process = commands.start(
        *("demo", "dog", "--live", "-o", tmp_path),
        stderr=subprocess.PIPE,
        env=os.environ | {"XDG_STATE_HOME": str(tmp_path / "state")},
    )
    with process:
        line = next(line for line in process.stderr if "serving" in line)
        assert "tcp://127.0.0.1:7400" in line
        report = json.loads(invoke("listen", "--seconds", 1, "--json").stdout)
        assert [each["topic"] for each in report["heard"]] == ["dog/controls"]
        process.terminate()
        assert process.wait() == 0


def test_a_restarted_service_does_not_wait_for_what_it_does_not_need():
    heavy = ("scipy.linalg", "scipy.spatial", "scipy.sparse.linalg", "zeroconf", "prometheus_client")
    program = f"import sys, engine_bridge.service.service; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
