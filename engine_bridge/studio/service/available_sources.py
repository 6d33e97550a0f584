"""Lists available sources: connected sensors and cameras, and ports with what arrives there now."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict

from capture.network.source import OSC_PORT, VMC_PORT
from capture.sensors.source_report import observe
from capture.sources.registry import open_source
from engine_bridge.inspection.finding import Finding
from engine_bridge.studio.messages.performers import Device, Port
from puppetline.errors import PuppetlineError

LISTEN_SECONDS = 1.0
"""Time for which each port is observed, in seconds."""

PORTS = {
    f"osc:{OSC_PORT}": f"OSC, port {OSC_PORT}: OSCeleton, NI mate, Nuitrack and others",
    f"vmc:{VMC_PORT}": f"VMC, port {VMC_PORT}: VSeeFace, VMC senders on phones and others",
}
"""URIs of the ports that are observed, and their names for people."""


def ports(used: str) -> list[Port]:
    """Return what arrives at each of the `PORTS`; the one whose URI is `used` is not opened."""
    with ThreadPoolExecutor(len(PORTS)) as pool:
        return list(pool.map(lambda uri: _port(uri, used), PORTS))


def device(finding: Finding) -> Device:
    """Return a finding of `puppetline doctor` with the URI of its source, if it has one."""
    return Device(**asdict(finding), uri=next(_uris(finding), ""))


def _uris(finding: Finding) -> Iterator[str]:
    """Yield the URI of a device, if it can be opened."""
    if finding.ok is not True:
        return
    if finding.name.startswith("/dev/video"):
        yield f"camera:{finding.name.removeprefix('/dev/video')}"
    if finding.name.startswith(("openni:serial=", "openni:uri=", "realsense:serial=", "orbbec:serial=")):
        yield finding.name
    if finding.detail.endswith(", for freenect:"):
        yield "freenect:"


def _port(uri: str, used: str) -> Port:
    if uri == used:
        return Port(uri=uri, text=PORTS[uri], problem="This port is the chosen source; the status shows what arrives.")
    try:
        with closing(open_source(uri)) as source:
            report = observe(source, LISTEN_SECONDS, LISTEN_SECONDS)
    except PuppetlineError as error:
        return Port(uri=uri, text=PORTS[uri], problem=f"{error.found[:1].upper()}{error.found[1:]}. {error.fix}")
    rates = [each.rate for each in report.performers.values() if each.rate is not None]
    arriving, rate = len(report.performers), max(rates, default=0.0)
    return Port(uri=uri, text=PORTS[uri], arriving=arriving, rate=rate, refused=dict(report.refused))
