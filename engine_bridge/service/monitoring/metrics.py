"""The status for Prometheus, at ``http://127.0.0.1:PORT/metrics``, served by prometheus_client."""

import ipaddress
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import astuple
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, make_server

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.exposition import ThreadingWSGIServer, make_wsgi_app
from prometheus_client.registry import Collector

from engine_bridge.service.monitoring.status import Status
from engine_bridge.service.states import STATES
from puppetline.errors import ServiceError

CLIENT_SECONDS = 2.0
"""Maximum time that a client may send nothing before its connection is closed, in seconds."""

MAX_CLIENTS = 16
"""Maximum number of clients served at the same time; further connections are closed."""

_POLL_SECONDS = 0.1  # maximum time until the server notices that it has to close


class MetricsServer:
    """Answers Prometheus in threads of its own.

    Parameters
    ----------
    status : callable
        Returns the latest status; it is called in those threads.
    port : int
        0 chooses a free one, which is then `port`.

    Raises
    ------
    ServiceError
        The port cannot be bound.
    """

    def __init__(self, status: Callable[[], Status], port: int) -> None:
        registry = CollectorRegistry()
        registry.register(_StatusCollector(status))
        try:
            self._server = make_server("127.0.0.1", port, _local_only(make_wsgi_app(registry)), _Server, _Handler)
        except (OSError, OverflowError) as error:
            raise ServiceError(
                f"metrics at 127.0.0.1:{port}",
                found=f"a port that cannot be bound ({error})",
                expected="a free port",
                fix="Choose another port, or close the program that uses it.",
            ) from error
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(_POLL_SECONDS,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Free the port. Closing again does nothing."""
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingWSGIServer):
    block_on_close = False  # a client that sends nothing must not delay the end
    request_queue_size = 4 * MAX_CLIENTS  # if the queue is full, a client retries only after a second or more

    def __init__(self, *arguments: Any) -> None:
        self._free = threading.BoundedSemaphore(MAX_CLIENTS)
        super().__init__(*arguments)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a client, or close its connection while others use all the threads."""
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a client in a thread of its own."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, *_request: object) -> None:
        """Ignore clients that disconnect or send garbage."""


class _Handler(WSGIRequestHandler):
    timeout = CLIENT_SECONDS

    def log_message(self, *_message: object) -> None:
        """Log nothing: Prometheus asks every few seconds."""


def _local_only(application: Callable[..., Iterable[bytes]]) -> Callable[..., Iterable[bytes]]:
    """Refuse requests for other hosts, so that a web page whose name points here (DNS rebinding) gets nothing."""

    def answer(environ: dict[str, Any], start_response: Callable[..., Any]) -> Iterable[bytes]:
        if _is_local(environ.get("HTTP_HOST", "")):
            return application(environ, start_response)
        start_response("421 Misdirected Request", [("Content-Type", "text/plain; charset=utf-8")])
        return [b"Use 127.0.0.1 or localhost as the host name.\n"]

    return answer


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
    def __init__(self, status: Callable[[], Status]) -> None:
        self._status = status

    def collect(self) -> Iterator[Metric]:
        """Turn the latest status into metrics."""
        status = self._status()
        for metrics in (_service, _stages, _characters, _outputs):
            yield from metrics(status)


def _service(status: Status) -> Iterator[Metric]:
    service, clients = status.service, status.clients
    yield InfoMetricFamily("puppetline", "The service.", {"version": service.version})
    yield _gauge("uptime_seconds", "Time since the start.", (), [((), service.uptime)])
    yield _gauge("resident_memory_bytes", "Memory of the process.", (), [((), service.memory)])
    yield _gauge("cpu_share", "Share of one core since the last status.", (), [((), service.cpu)])
    yield _gauge("clients_connected", "Connected ZeroMQ clients.", (), [((), clients.connected)])
    yield _gauge("clients_limit", "Maximum number of ZeroMQ clients.", (), [((), clients.limit)])
    yield _counter("clients_refused", "Refused ZeroMQ connections.", (), [((), clients.refused)])


def _stages(status: Status) -> Iterator[Metric]:
    stages, label = status.stages, ("stage",)
    yield _counter("stage_frames", "Skeletons received.", label, (((s.name,), s.frames) for s in stages))
    about = "Skeletons skipped because a newer one had arrived."
    yield _counter("stage_dropped", about, label, (((s.name,), s.dropped) for s in stages))
    refused = (((s.name, reason), count) for s in stages for reason, count in s.refused.items())
    yield _counter("stage_refused", "Packets that were not understood.", ("stage", "reason"), refused)
    latencies = (
        ((stage.name, quantile), milliseconds / 1000)
        for stage in stages
        for quantile, milliseconds in zip(("0.5", "0.95", "0.99", "1"), astuple(stage.latency_ms), strict=True)
        if milliseconds is not None
    )
    yield _gauge("latency_seconds", "Time from a skeleton to its frame.", ("stage", "quantile"), latencies)
    yield _gauge("stage_users", "Performers in view.", label, (((s.name,), len(s.users)) for s in stages))
    recording = (((s.name,), s.recording is not None) for s in stages)
    yield _gauge("stage_recording", "1 while a take is recorded.", label, recording)


def _characters(status: Status) -> Iterator[Metric]:
    characters, label = status.characters, ("character",)
    yield _counter("character_frames", "Frames sent.", label, (((c.name,), c.frames) for c in characters))
    states = (((c.name, state), c.state == state) for c in characters for state in STATES)
    yield _gauge("character_state", "1 for the current state.", ("character", "state"), states)
    residuals = (((c.name,), c.residual) for c in characters if c.residual is not None)
    yield _gauge("character_residual", "Distance of the last pose from the morph basis.", label, residuals)
    limited = (((c.name,), c.limited) for c in characters if c.residual is not None)
    about = "Frames whose pose exceeds the range of the morph weights."
    yield _counter("character_limited_frames", about, label, limited)


def _outputs(status: Status) -> Iterator[Metric]:
    outputs, labels = status.outputs, ("wire", "target")
    yield _counter("output_sent", "Messages sent.", labels, (((o.wire, o.target), o.sent) for o in outputs))
    yield _counter("output_sent_bytes", "Bytes sent.", labels, (((o.wire, o.target), o.bytes) for o in outputs))
    skipped = (((o.wire, o.target), o.skipped) for o in outputs if o.skipped is not None)
    yield _counter("output_skipped", "Frames replaced by newer ones before they were sent.", labels, skipped)
    yield _counter("output_failed", "Messages not sent.", labels, (((o.wire, o.target), o.failed) for o in outputs))
    clients = (((o.wire, o.target), o.clients) for o in outputs if o.clients is not None)
    yield _gauge("output_clients", "Clients of this wire.", labels, clients)
    refused = (((o.wire, o.target), o.refused) for o in outputs if o.clients is not None)
    yield _counter("output_refused", "Refused connections of this wire.", labels, refused)


_Samples = Iterable[tuple[tuple[str, ...], float]]


def _counter(name: str, about: str, labels: tuple[str, ...], samples: _Samples) -> Metric:
    return _filled(CounterMetricFamily(f"puppetline_{name}", about, labels=labels), samples)


def _gauge(name: str, about: str, labels: tuple[str, ...], samples: _Samples) -> Metric:
    return _filled(GaugeMetricFamily(f"puppetline_{name}", about, labels=labels), samples)


def _filled(family: Any, samples: _Samples) -> Metric:
    for labels, value in samples:
        family.add_metric(labels, value)
    return family
