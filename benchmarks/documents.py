"""The document that measurements are written to."""

import re
from pathlib import Path

DOCUMENT = Path(__file__).parents[1] / "docs" / "performance.md"
IMAGES = DOCUMENT.with_name("images")


def replaced(text: str, name: str, lines: list[str]) -> str:
    """Replace the lines between <!-- name --> and <!-- /name -->."""
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
    if not pattern.search(text):
        raise SystemExit(f"{DOCUMENT}: no lines between <!-- {name} --> and <!-- /{name} -->")
    return pattern.sub(lambda found: "\n".join([found[1].rstrip(), *lines, found[2]]), text)
