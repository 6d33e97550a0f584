"""The report: a page in one file, with histograms and contact sheets of the worst results."""

import base64
import io
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

from PIL import Image

from engine_bridge.batch.conversion import BatchSettings, solve_again
from engine_bridge.batch.histogram import histogram
from engine_bridge.batch.row import Row
from engine_bridge.batch.store import Store
from engine_bridge.pictures import clip_sheet
from puppetline.errors import PuppetlineError
from puppetline.files import written_whole

WORST_COUNT = 12
"""Number of results that are drawn."""

JPEG_QUALITY = 80
"""Quality of the contact sheets, in per cent."""

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #34363c; background: #fafafb; margin: 2em auto; max-width: 90em;
  padding: 0 1em }
.charts { display: grid; grid-template-columns: repeat(auto-fit, minmax(22em, 1fr)); gap: 2em }
svg { width: 100% } rect { fill: #4a7fb5 } line { stroke: #34363c } text { font-size: 11px; fill: #34363c }
figure { margin: 2em 0 } img { width: 100%; border: 1px solid #ddd }
td, th { text-align: left; padding: .2em 1em .2em 0; vertical-align: top }
"""

Progress = Callable[[float], None]


def write_report(path: Path, rows: Sequence[Row], store: Store, batch: BatchSettings, progress: Progress) -> None:
    """Write the report about the results in a folder.

    The contact sheets are kept, so that the next report draws only those that do not exist yet.

    Parameters
    ----------
    path : Path
    rows : sequence of Row
    store : Store
    batch : BatchSettings
    progress : callable
        Called with the share of the contact sheets that are done.

    Raises
    ------
    OutputError
    """
    done = [row for row in rows if row.state == "done"]
    failed = [row for row in rows if row.state == "failed"]
    worst = sorted((row for row in done if row.puppet), key=badness, reverse=True)[:WORST_COUNT]
    figures = []
    for number, row in enumerate(worst, 1):
        figures.append(_figure(row, store, batch))
        progress(number / len(worst))
    parts = [
        f"<h1>{len(done):,} results, {len(failed):,} failed</h1>",
        f'<div class="charts">{"".join(_charts(done))}</div>',
        *([_failures(failed)] if failed else []),
        *(["<h2>The worst results: largest stretch of edges, then largest error</h2>", *figures] if figures else []),
    ]
    title = escape(f"Puppetline: {store.folder.name}")
    with written_whole(path) as beside:
        beside.write_text(
            f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
            f"<style>{STYLE}</style></head><body>\n" + "\n".join(parts) + "\n</body></html>\n",
            encoding="utf-8",
        )


def badness(row: Row) -> tuple[float, float]:
    """Return the key that sorts results: the stretch or compression of edges, then the error.

    The stretch is the 99th percentile, or the inverse of the 1st one if that is larger.
    """
    stretch = 0.0
    if row.stretch_p1 is not None and row.stretch_p99 is not None:
        stretch = max(row.stretch_p99, 1 / max(row.stretch_p1, 1e-6))
    return stretch, row.error or 0.0


def _charts(rows: Sequence[Row]) -> list[str]:
    """Return the histograms of the values that are known."""
    columns = {
        "duration in seconds": [row.seconds for row in rows],
        "largest error of a vertex, as a fraction of the diagonal": [row.error for row in rows],
        "edge stretch, 99th percentile": [row.stretch_p99 for row in rows],
        "edge stretch, 1st percentile": [row.stretch_p1 for row in rows],
    }
    known = {label: [value for value in values if value is not None] for label, values in columns.items()}
    return [f"<div>{histogram(values, label)}</div>" for label, values in known.items() if values]


def _failures(rows: Sequence[Row]) -> str:
    """Return a table of all failures."""
    lines = "".join(f"<tr><td>{escape(Path(row.puppet).stem)}</td><td>{escape(row.message)}</td></tr>" for row in rows)
    return f"<h2>Failed</h2><table><tr><th>puppet</th><th>message</th></tr>{lines}</table>"


def _figure(row: Row, store: Store, batch: BatchSettings) -> str:
    """Return the contact sheet of a result with its numbers."""
    try:
        picture = f'<img alt="frames of the result" src="data:image/jpeg;base64,{_sheet(row, store, batch)}">'
    except PuppetlineError as error:
        picture = f"<p>No picture: {escape(str(error))}</p>"
    stretch = ""
    if row.stretch_p1 is not None and row.stretch_p99 is not None:
        stretch = f", edge stretch {row.stretch_p1:.3f} … {row.stretch_p99:.3f}"
    text = f"{row.output}: {row.seconds:.1f} s{stretch}, error {row.error or 0:.2g} of the diagonal"
    return f"<figure><figcaption>{escape(' — '.join((text, *row.notes)))}</figcaption>{picture}</figure>"


def _sheet(row: Row, store: Store, batch: BatchSettings) -> str:
    """Return a contact sheet as JPEG in base64; draw it if it was never drawn.

    Raises
    ------
    PuppetlineError
        The recording or the puppet can no longer be read.
    """
    path = store.sheet(row)
    if not path.is_file():
        clip = solve_again(row, batch.settings)
        title = f"{Path(row.puppet).stem} · {Path(row.log).stem}"
        clip_sheet.draw(clip, path, title, file=batch.folder / row.output)
    jpeg = io.BytesIO()
    with Image.open(path) as image:
        image.convert("RGB").save(jpeg, "JPEG", quality=JPEG_QUALITY)
    return base64.b64encode(jpeg.getvalue()).decode()
