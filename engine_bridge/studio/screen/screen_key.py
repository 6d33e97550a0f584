"""The key of screens: it lasts across restarts, and opens nothing but what a screen shows."""

import hmac
from pathlib import Path

from engine_bridge.service.security.credentials import make_token, read_token
from puppetline.errors import PuppetlineError


class ScreenKey:
    """A key in a file.

    Parameters
    ----------
    file : Path
        It is made if it is missing. A screen that connects later needs what the file holds then, so that the key is
        revoked by deleting or replacing the file.

    Raises
    ------
    PuppetlineError
        The file cannot be written, or others may read it.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        if not file.is_file():
            file.parent.mkdir(parents=True, exist_ok=True)
            make_token(file)
        self.text = str(read_token(file))

    def opens(self, token: str) -> bool:
        """Tell whether a token is the key."""
        try:
            return hmac.compare_digest(token.encode(errors="surrogatepass"), str(read_token(self._file)).encode())
        except PuppetlineError:
            return False
