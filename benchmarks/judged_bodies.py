"""Measures on characters that nobody tuned for how often `puppetline new` is right.

    python -m benchmarks.judged_bodies FOLDER [--wrong]

FOLDER contains the characters that `judged_bodies.jsonl` lists: `file` in it is `path` in a public repository. A person
has said of each where up and front are and how many arms, legs and wings it has, before any program was asked; joints
of the file were not looked at. A front between two axes counts for the nearer one. No weights are fitted to them;
`STANDS_WEIGHT` of `solver.anatomy.body_decision` was tried on those with a skeleton.

The lines say for how many up and front are right, and for how many the numbers of limbs as well, for characters with
a skeleton and without one; with --wrong, each wrong character and what was found is named.
"""

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from engine_bridge.puppet.proposal import new_puppet
from puppetline.errors import PuppetlineError
from solver.anatomy.axes import unit_vector

LIST = Path(__file__).with_name("judged_bodies.jsonl")
LIMBS = ("arm", "leg", "wing")
MIN_COSINE = 0.6
"""Minimum cosine between a right direction and the one that a person has named."""


def judged(folder: Path) -> Iterator[tuple[dict[str, Any], bool, bool, str]]:
    """Yield each listed character of a folder, whether up and front are right, limbs as well, and what was found."""
    for line in LIST.read_text(encoding="utf-8").splitlines():
        row = json.loads(line)
        path = folder / row["file"]
        if not path.exists():
            continue
        try:
            made = new_puppet(path, path.with_suffix(".toml"))
        except PuppetlineError as error:
            yield row, False, False, str(error)
            continue
        basis, names = made.puppet.character.basis, [limb.name.split() for limb in made.puppet.limb]
        stands = all(basis[k] @ unit_vector(row[way]) > MIN_COSINE for k, way in ((1, "up"), (2, "front")))
        counts = [sum(limb in name for name in names) for limb in LIMBS]
        character = made.puppet.character
        found = f"up {character.up}, front {character.front}, turn {character.turn:g}: {made.summary}"
        yield row, stands, stands and counts == row["limbs"], found


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--wrong", action="store_true")
    options = parser.parse_args()
    totals: dict[str, Counter[str]] = {"with a skeleton": Counter(), "without": Counter()}
    for row, stands, whole, found in judged(options.folder):
        totals["with a skeleton" if row["joints"] else "without"].update(
            {"characters": 1, "up and front": int(stands), "and limbs": int(whole)}
        )
        if options.wrong and not whole:
            print(f"{row['file']} ({row['kind']}): {found}")
    for kind, counts in totals.items():
        print(f"{kind}: " + ", ".join(f"{what} {count}" for what, count in counts.items()))


if __name__ == "__main__":
    main()
