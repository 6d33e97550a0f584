"""Errors that end one thing, while the studio continues."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from puppetline.errors import PuppetlineError

log = logging.getLogger(__name__)


@contextmanager
def logged_errors(what: str) -> Iterator[None]:
    """Log an error of what is opened, or written beside, with a sentence about what does not work."""
    try:
        yield
    except (PuppetlineError, ValueError, KeyError, TypeError) as error:
        log.warning("%s: %s", what, error)
