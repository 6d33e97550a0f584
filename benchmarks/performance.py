"""Update the tables and plots of docs/performance.md; takes about ten minutes on an otherwise idle machine.

python -m benchmarks.performance [--data FOLDER] [--only goals,table1,convergence,live] [--live FILE]

FOLDER is searched for armadillo.obj, the Armadillo of libigl's tutorial data with 43,243 vertices; the default is an
example character with as many vertices. The live service (`benchmarks.live`) takes three quarters of an hour and is
measured only if --only names it. With --live, its table is made from the FILE of `benchmarks.live --keep`.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

from puppetline.examples.performances import PERFORMANCES

from benchmarks import character_cost, goals, live, plots, scaling, table1
from benchmarks.documents import DOCUMENT, IMAGES, replaced
from benchmarks.own_cache import own_cache
from benchmarks.processes import MODULE

PARTS = ("goals", "table1", "convergence")
LIVE = "live"


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="a folder that contains armadillo.obj")
    parser.add_argument("--only", default=",".join(PARTS), help=f"a part of {','.join((*PARTS, LIVE))}")
    parser.add_argument("--live", type=Path, metavar="FILE", help="measurements from benchmarks.live --keep")
    options = parser.parse_args()
    todo = options.only.split(",")
    mesh = min(options.data.rglob("armadillo.obj"), default=None) if options.data else None
    with tempfile.TemporaryDirectory() as folder, own_cache(Path(folder)):
        scratch, subject = Path(folder), Path(folder) / "subject"
        subject.mkdir()
        character = character_cost.prepare(subject, mesh, character_cost.CONVERTED_FRAMES)
        tables = {}
        if "goals" in todo:
            say("Cost against vertices")
            points = scaling.measured(scratch, subject, say)
            plots.cost(points, IMAGES / "cost.svg")
            say("Goals")
            tables["goals"] = list(goals.table(subject, character, points))
        if "table1" in todo:
            say("Table 1")
            tables["table1"] = list(table1.table(scratch))
        if "convergence" in todo:
            say("Convergence")
            character_cost.write_log(subject, PERFORMANCES["kung_fu"]().frames())
            plots.convergence(
                character_cost.in_process(subject, "convergence", module=MODULE), IMAGES / "convergence.svg"
            )
        if LIVE in todo and options.live is None:
            say("The live service")
            tables[LIVE] = list(live.table(live.measure(subject, character, live.Plan(), live.PARTS, say)))
    if options.live is not None:
        tables[LIVE] = list(live.table(json.loads(options.live.read_text(encoding="utf-8"))))
    text = DOCUMENT.read_text(encoding="utf-8")
    for name, lines in tables.items():
        text = replaced(text, name, lines)
    DOCUMENT.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
