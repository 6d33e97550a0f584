"""A Sphinx extension for links: those to folders of the repository become text, and a broken one is a warning."""

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from sphinx.application import Sphinx
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)


class _Page(HTMLParser):
    """The ids and the local links of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: ARG002
        for name, value in attrs:
            if name == "id" and value:
                self.ids.add(value)
            elif name in ("href", "src") and value and not urlsplit(value).scheme:
                self.links.add(value)


def _folders_to_text(app: Sphinx, name: str, source: list[str]) -> None:
    folder = (Path(app.srcdir) / name).parent

    def text(match: re.Match[str]) -> str:
        is_folder = (folder / match[2]).is_dir()
        return f"`{match[1]}`" if is_folder else match[0]

    source[0] = re.sub(r"\[([^\]]+)\]\((\.\./[^)#]+)\)", text, source[0])


def _check(app: Sphinx, failure: Exception | None) -> None:
    if failure or app.builder.name != "html":
        return
    pages = {path: _Page(path) for path in sorted(Path(app.outdir).rglob("*.html"))}
    for path, page in pages.items():
        for link in sorted(page.links):
            target = urlsplit(link)
            file = (path.parent / unquote(target.path)).resolve() if target.path else path
            if not file.exists() or (
                target.fragment and file in pages and unquote(target.fragment) not in pages[file].ids
            ):
                LOGGER.warning("%s: found a link to %s; expected a file, and an anchor in it", path, link)


def _make_accessible(app: Sphinx, failure: Exception | None) -> None:
    """Give captions their level, and let the keyboard reach boxes that scroll: the theme does neither."""
    for path in () if failure or app.builder.name != "html" else Path(app.outdir).rglob("*.html"):
        text = path.read_text(encoding="utf-8").replace('role="heading">', 'role="heading" aria-level="2">')
        text = text.replace("<pre>", '<pre tabindex="0">')
        path.write_text(text.replace('<div class="table-wrapper', '<div tabindex="0" class="table-wrapper'), "utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension."""
    app.connect("source-read", _folders_to_text)
    app.connect("build-finished", _make_accessible)
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True}
