"""An animated character or performer to look at: in a notebook, or as a web page that needs no network."""

import base64
import html
from os import PathLike
from pathlib import Path

from puppetline.errors import OutputError
from puppetline.files import check_writable, written_whole

SCRIPT = Path(__file__).parents[1] / "engine_bridge" / "studio" / "page" / "dist" / "player.js"

PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>
<style>
html, body {{ margin: 0; height: 100% }}
canvas {{ display: block; width: 100%; height: 100%; touch-action: none }}
</style>
<canvas aria-label="{title}; drag to turn it"></canvas><script type="text/plain" id="glb">{glb}</script>
<script>{script}</script></html>"""


class Player:
    """A .glb that plays in a loop; drag to turn it.

    A notebook shows it as the value of a cell.

    Parameters
    ----------
    glb : bytes
        Content of the file.
    title : str
    """

    def __init__(self, glb: bytes, title: str) -> None:
        self._glb, self._title = glb, title

    def page(self) -> str:
        """Return a web page that contains everything that it needs.

        Raises
        ------
        OutputError
            The player has not been built, in a checkout.
        """
        if not SCRIPT.is_file():
            raise OutputError(
                SCRIPT, found="no such file", expected="the player, which is built", fix="Call make studio."
            )
        script = SCRIPT.read_text(encoding="utf-8").replace("</script", r"<\/script")
        glb = base64.b64encode(self._glb).decode()
        return PAGE.format(title=html.escape(self._title), glb=glb, script=script)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the web page.

        Raises
        ------
        OutputError
        """
        check_writable(Path(path), ".html")
        with written_whole(Path(path)) as beside:
            beside.write_text(self.page(), encoding="utf-8")

    def _repr_html_(self) -> str:
        style = "width: 100%; height: 400px; border: 0"
        return (
            f'<iframe style="{style}" title="{html.escape(self._title)}" srcdoc="{html.escape(self.page())}"></iframe>'
        )

    def __repr__(self) -> str:
        return f"<puppetline.Player of {self._title}>"
