"""The status (`engine_bridge.service.monitoring.statistics`) for Prometheus, at ``http://127.0.0.1:PORT/metrics``."""

import ipaddress
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from typing import Any

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest
from prometheus_client.registry import Collector

from puppetline.errors import ServiceError

STATES = ("waiting", "calibrating", "performing", "leaving")

PATIENCE = 2.0
"""Seconds that a client may keep silent before it is let go."""

_POLL = 0.1  # seconds until the end of the service is noticed


class MetricsServer:
    """Answers Prometheus, in threads of its own.

    Parameters
    ----------
    status : callable
        Returns the latest status; it is called in that thread.
    port : int
        0 takes a free one, which is then `port`.
    host : str
        The address to listen at. On loopback a request must be for an address or ``localhost``, so that a web page that
        has its own name point here (DNS rebinding) gets nothing.

    Raises
    ------
    ServiceError
        If the port is not to be had.
    """

    def __init__(self, status: Callable[[], dict[str, Any]], port: int, host: str = "127.0.0.1") -> None:
        registry = CollectorRegistry()
        registry.register(_StatusCollector(status))
        try:
            self._server = _Server(host, port, registry)
        except (OSError, OverflowError) as error:
            raise ServiceError(
                f"metrics at {host}:{port}",
                found=f"that nothing can listen there ({error})",
                expected="an address of this machine and a free port",
                fix="Choose another port, or end the program that has it.",
            ) from error
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(_POLL,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Free the port. Closing again does nothing."""
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = True
    block_on_close = False  # who asks and then says nothing holds up nobody, and the end least of all

    def __init__(self, host: str, port: int, registry: CollectorRegistry) -> None:
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self.registry = registry
        super().__init__((host, port), _Handler)
        self.local = ipaddress.ip_address(str(self.server_address[0])).is_loopback

    def handle_error(self, *_request: object) -> None:
        """Say nothing: a client that has gone is no concern of ours."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = PATIENCE

    def do_GET(self) -> None:
        """Give the metrics."""
        if self.server.local and not _is_local(self.headers.get("Host", "")):
            self._answer(HTTPStatus.MISDIRECTED_REQUEST, b"Ask for 127.0.0.1 or localhost.\n")
        elif self.path != "/metrics":
            self._answer(HTTPStatus.NOT_FOUND, b"There is /metrics here.\n")
        else:
            self._answer(HTTPStatus.OK, generate_latest(self.server.registry), CONTENT_TYPE_LATEST)

    def _answer(self, status: HTTPStatus, body: bytes, kind: str = "text/plain; charset=utf-8") -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_message: object) -> None:
        """Say nothing: who asks every few seconds would fill the log."""


def _is_local(host: str) -> bool:
    name = host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() else host
    if name == "localhost":
        return True
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


class _StatusCollector(Collector):
    def __init__(self, status: Callable[[], dict[str, Any]]) -> None:
        self._status = status

    def collect(self) -> Iterator[Metric]:
        """Turn the latest status into metrics."""
        status = self._status()
        yield from _service(status["service"], status["clients"])
        yield from _stages(status["stages"])
        yield from _characters(status["characters"])
        for what, value in status["sent"].items():
            yield _counter(f"sent_{what}", "Sent over ZeroMQ.", (), [((), value)])
        for what in ("sent", "skipped", "failed"):
            yield _counter(
                f"osc_{what}",
                "Frames for an OSC target.",
                ("target",),
                [((t["target"],), t[what]) for t in status["osc"]],
            )


def _service(service: dict[str, Any], clients: dict[str, int]) -> Iterator[Metric]:
    yield InfoMetricFamily("puppetline", "The service.", {"version": service["version"]})
    yield _gauge("uptime_seconds", "Since the start.", (), [((), service["uptime"])])
    yield _gauge("resident_memory_bytes", "Of the process.", (), [((), service["memory"])])
    yield _gauge("cpu_share", "Of one core, since the last status.", (), [((), service["cpu"])])
    yield _gauge("clients_connected", "Over ZeroMQ.", (), [((), clients["connected"])])
    yield _gauge("clients_limit", "The most that are let in.", (), [((), clients["limit"])])
    yield _counter("clients_refused", "Turned away.", (), [((), clients["refused"])])


def _stages(stages: Sequence[dict[str, Any]]) -> Iterator[Metric]:
    yield _counter("stage_frames", "Skeletons taken in.", ("stage",), [((s["name"],), s["frames"]) for s in stages])
    yield _counter(
        "stage_dropped",
        "Skeletons overtaken by newer ones.",
        ("stage",),
        [((s["name"],), s["dropped"]) for s in stages],
    )
    refused = [((s["name"], reason), count) for s in stages for reason, count in s["refused"].items()]
    yield _counter("stage_refused", "Packets that were not understood.", ("stage", "reason"), refused)
    latencies = [
        ((s["name"], quantile), s["latency_ms"][key] / 1000)
        for s in stages
        for key, quantile in (("p50", "0.5"), ("p95", "0.95"), ("p99", "0.99"), ("max", "1"))
        if s["latency_ms"][key] is not None
    ]
    yield _gauge("latency_seconds", "From skeleton in to character out, lately.", ("stage", "quantile"), latencies)
    yield _gauge("stage_users", "Performers in view.", ("stage",), [((s["name"],), len(s["users"])) for s in stages])
    recording = [((s["name"],), s["recording"] is not None) for s in stages]
    yield _gauge("stage_recording", "1 while a take is recorded.", ("stage",), recording)


def _characters(characters: Sequence[dict[str, Any]]) -> Iterator[Metric]:
    yield _counter(
        "character_frames", "Frames performed.", ("character",), [((c["name"],), c["frames"]) for c in characters]
    )
    states = [((c["name"], state), c["state"] == state) for c in characters for state in STATES]
    yield _gauge("character_state", "1 for the state that it is in.", ("character", "state"), states)
    residuals = [((c["name"],), c["residual"]) for c in characters if c["residual"] is not None]
    yield _gauge("character_residual", "Of the last pose, on the morph basis.", ("character",), residuals)
    limited = [((c["name"],), c["limited"]) for c in characters if c["residual"] is not None]
    about = "Frames whose pose is beyond the range of the morph weights."
    yield _counter("character_limited_frames", about, ("character",), limited)


_Samples = Sequence[tuple[tuple[str, ...], float]]


def _counter(name: str, about: str, labels: tuple[str, ...], samples: _Samples) -> Metric:
    return _filled(CounterMetricFamily(f"puppetline_{name}", about, labels=labels), samples)


def _gauge(name: str, about: str, labels: tuple[str, ...], samples: _Samples) -> Metric:
    return _filled(GaugeMetricFamily(f"puppetline_{name}", about, labels=labels), samples)


def _filled(family: Any, samples: _Samples) -> Metric:
    for labels, value in samples:
        family.add_metric(labels, value)
    return family
