"""The live service, and the commands that are used with it."""

import json
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow


def test_bake_makes_a_file_that_serve_plays(invoke, play, blob_puppet):
    count = json.loads(invoke("bake", blob_puppet, "-o", "blob.morphs.glb", "--targets", 8, "--json").stdout)["targets"]
    service = play("--puppet", blob_puppet, "--source", "demo:walk?loop", "--morphs", "blob.morphs.glb")
    service.until(lambda: service.frames and service.frames[-1].state == "performing")
    service.run(1.0)
    assert {frame.morphs.weights.shape for frame in service.frames} == {(count,)}
    assert 0 < service.frames[-1].morphs.residual < 0.05
    assert service.ask("describe")["characters"][0]["morphs"] == [f"motion_{k}" for k in range(count)]


def test_demo_live_streams_the_examples_and_listen_reports_them(tmp_path, invoke, commands):
    with commands.start("demo", "dog", "--live", "-o", tmp_path, stderr=subprocess.PIPE) as process:
        line = next(line for line in process.stderr if "serving" in line or "cannot be bound" in line)
        if "cannot be bound" in line:
            pytest.skip("another program has the default port")
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
