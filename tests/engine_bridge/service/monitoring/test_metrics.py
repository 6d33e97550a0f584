import http.client
import socket
import threading
from contextlib import ExitStack
from dataclasses import replace

import pytest
from prometheus_client.parser import text_string_to_metric_families

from engine_bridge.service.monitoring.metrics import MAX_CLIENTS, MetricsServer
from puppetline.errors import ServiceError

from ...refusals import refused


@pytest.fixture
def server(status):
    stage = replace(status.stages[0], refused={'not "OSC"\n': 2, "short": 1})
    server = MetricsServer(lambda: replace(status, stages=[stage]), 0)
    yield server
    server.close()


def ask(port, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", port)
    connection.request(method, "/metrics", headers=headers)
    response = connection.getresponse()
    body = response.read().decode()
    connection.close()
    return response, body


def samples(body):
    return {
        (sample.name, *sorted(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(body)
        for sample in family.samples
    }


METRICS = r"""
puppetline_info{version="1.2.3"} 1
puppetline_uptime_seconds 3725.5
puppetline_resident_memory_bytes 123e6
puppetline_cpu_share 0.25
puppetline_clients_connected 3
puppetline_clients_limit 64
puppetline_clients_refused_total 2
puppetline_stage_frames_total{stage="kinect"} 900
puppetline_stage_dropped_total{stage="kinect"} 4
puppetline_stage_refused_total{stage="kinect",reason="not \"OSC\"\n"} 2
puppetline_stage_refused_total{stage="kinect",reason="short"} 1
puppetline_latency_seconds{stage="kinect",quantile="0.5"} 0.001234
puppetline_latency_seconds{stage="kinect",quantile="0.95"} 0.0025
puppetline_latency_seconds{stage="kinect",quantile="1"} 0.009
puppetline_stage_users{stage="kinect"} 2
puppetline_stage_recording{stage="kinect"} 1
puppetline_character_state{character="dog",state="waiting"} 0
puppetline_character_state{character="dog",state="calibrating"} 0
puppetline_character_state{character="dog",state="performing"} 1
puppetline_character_state{character="dog",state="leaving"} 0
puppetline_character_state{character="cat",state="waiting"} 1
puppetline_character_state{character="cat",state="calibrating"} 0
puppetline_character_state{character="cat",state="performing"} 0
puppetline_character_state{character="cat",state="leaving"} 0
puppetline_character_frames_total{character="dog"} 890
puppetline_character_frames_total{character="cat"} 10
puppetline_character_residual{character="dog"} 0.0123
puppetline_character_limited_frames_total{character="dog"} 7
puppetline_output_sent_total{wire="zeromq",target="tcp://127.0.0.1:7400"} 5000
puppetline_output_sent_bytes_total{wire="zeromq",target="tcp://127.0.0.1:7400"} 10
puppetline_output_failed_total{wire="zeromq",target="tcp://127.0.0.1:7400"} 0
puppetline_output_sent_total{wire="osc",target="127.0.0.1:9000"} 90
puppetline_output_sent_bytes_total{wire="osc",target="127.0.0.1:9000"} 2000
puppetline_output_skipped_total{wire="osc",target="127.0.0.1:9000"} 12
puppetline_output_failed_total{wire="osc",target="127.0.0.1:9000"} 1
puppetline_output_sent_total{wire="websocket",target="ws://127.0.0.1:7402"} 70
puppetline_output_sent_bytes_total{wire="websocket",target="ws://127.0.0.1:7402"} 500
puppetline_output_skipped_total{wire="websocket",target="ws://127.0.0.1:7402"} 5
puppetline_output_failed_total{wire="websocket",target="ws://127.0.0.1:7402"} 0
puppetline_output_clients{wire="websocket",target="ws://127.0.0.1:7402"} 2
puppetline_output_refused_total{wire="websocket",target="ws://127.0.0.1:7402"} 4
"""


def test_prometheus_reads_the_whole_status(server):
    response, body = ask(server.port)
    assert response.status == 200
    assert response.headers["Content-Type"].startswith("text/plain; version=")
    assert samples(body) == pytest.approx(samples(METRICS))


def test_requests_are_answered_that_are_for_this_machine_and_only_read(server):
    for host in ("localhost", "localhost:9464", "127.0.0.1", "127.0.0.1:9464", "[::1]:9464", "[::1]"):
        assert ask(server.port, Host=host)[0].status == 200
    for host in ("evil.example", "evil.example:9464", "", "localhost.evil.example", "127.0.0.1.nip.example"):
        response, body = ask(server.port, Host=host)
        assert response.status == 421, "a web page whose name points here"
        assert "puppetline" not in body
    assert ask(server.port, method="POST")[0].status == 405


def test_the_port_is_this_machines_alone_and_free_again_when_it_is_closed(status):
    server = MetricsServer(lambda: status, 0)
    assert server._server.server_address == ("127.0.0.1", server.port)
    where = refused(ServiceError, MetricsServer, lambda: status, server.port).where
    assert where == f"metrics at 127.0.0.1:{server.port}"
    server.close()
    MetricsServer(lambda: status, server.port).close()
    server._thread.join()


def test_clients_that_send_nothing_take_no_more_threads_than_there_are_and_are_closed(server):
    before = threading.active_count()
    with ExitStack() as clients:
        silent = [
            clients.enter_context(socket.create_connection(("127.0.0.1", server.port))) for _ in range(3 * MAX_CLIENTS)
        ]
        assert [client.recv(1) for client in silent[MAX_CLIENTS:]] == [b""] * (2 * MAX_CLIENTS)
        assert threading.active_count() <= before + MAX_CLIENTS
        assert [client.recv(1) for client in silent[:MAX_CLIENTS]] == [b""] * MAX_CLIENTS  # after CLIENT_SECONDS
    assert ask(server.port)[0].status == 200
