"""Films that phones open by their codes."""

import io
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import segno

MARGIN = 4
"""Width of the white margin of a QR code in modules, which readers need (ISO/IEC 18004)."""


class Films(Protocol):
    """Films, each with a code."""

    def film_file(self, code: str, ending: str) -> Path | None:
        """Return the film (``".mp4"``), poster (``".jpg"``) or ``".gif"`` of a code; None if there is none."""


@dataclass(frozen=True)
class FilmFolder:
    """A folder with films whose names are their codes, see `Films`."""

    path: Path

    def film_file(self, code: str, ending: str) -> Path | None:
        """Return a file of a film."""
        path = self.path / (code + ending)
        return path if path.with_suffix(".mp4").is_file() and path.is_file() else None


def qr_code(text: str) -> bytes:
    """Return the QR code of an address as an SVG picture."""
    image = io.BytesIO()
    segno.make(text, error="m", micro=False).save(image, kind="svg", border=MARGIN, light="white")
    return image.getvalue()


def free_listener(port: int) -> socket.socket:
    """Return a socket that listens on all addresses of this machine, at a port or, if that is in use, at any other."""
    try:
        return socket.create_server(("", port))
    except OSError:
        return socket.create_server(("", 0))
