"""Fits the weights of `solver.anatomy.limb_counts`, and judges them on characters that were held out.

    python -m benchmarks.limb_counts FOLDER [--write]

FOLDER contains the characters that `shapes.jsonl` lists. Each has its up and front, and the numbers of pairs of arms,
legs and wings, and of tails, that a person sees; null is any number, and some bodies may be seen in two ways. None of
these characters was shown to the network. The weights are also fitted to bodies that are made by rule, for plans that
are rare. They are those of a conditional logistic regression over all bodies, drawn to `START`.

The first lines say for how many of the listed characters the numbers are right, each by weights that were fitted
without the fifth in which it is; the fifths are drawn three times. The next lines say how often answers of a
probability are right, and how often the second likeliest body is where the first is wrong, by weights that were fitted
to all. With --write, these replace those of the solver.
"""

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from benchmarks.made_bodies import PLANS, made
from engine_bridge.character.character import load_character
from solver.anatomy import limb_counts
from solver.anatomy.axes import basis_of
from solver.anatomy.limb_counts import MEASURES, MOST, load_weights, measured, pairs_of
from solver.anatomy.part_network import PARTS
from solver.anatomy.solid import Solid, solid_of
from solver.anatomy.voted_limbs import voted_limbs, votes_of

SHAPES = Path(__file__).with_name("shapes.jsonl")
FOLDS, ROUNDS, STRENGTH = 5, 3, 0.3
"""Number of parts of which each is held out, and of their random divisions, and how strongly weights are drawn."""

MADE, LUMPS = 3, 12
"""Number of bodies that are made by rule of each plan, and of shapes without limbs."""

START = np.tile([1.0, 0.3, 0.6, 0.6, -2.0, -2.0], (len(MOST), 1))
"""Weights (4, 6) to which those of each part are drawn: its bias, then `MEASURES`."""

ABSENT = -50.0
"""Log odds of a body with pairs that nobody voted for."""

Array = NDArray[np.float64]


@dataclass
class Example:
    """A character.

    Attributes
    ----------
    pairs : list of (n, 5) float64
        `MEASURES` of the pairs of each part, the largest first.
    right : (b,) bool
        Which of all bodies a person sees.
    """

    pairs: list[Array]
    right: NDArray[np.bool_]


def listed(folder: Path) -> list[Example]:
    """Return the characters of the list that the folder contains."""
    found = []
    for row in map(json.loads, SHAPES.read_text(encoding="utf-8").splitlines()):
        if (folder / row["file"]).exists():
            mesh = load_character(folder / row["file"]).solver_mesh()
            solid = solid_of(mesh).along(basis_of(row["up"], row["front"]))
            found.append(Example(pairs_in(solid), is_right(row["bodies"])))
    return found


def made_by_rule() -> list[Example]:
    """Return bodies of all plans of `benchmarks.made_bodies`."""
    found = []
    for number, plan in enumerate(PLANS):
        for body in range(LUMPS if plan == "lump" else MADE):
            cells, depths, _, limbs = made(plan, np.random.default_rng([number, body]))
            seen = Counter(PARTS[part] for part, _ in limbs)
            counts = [seen[part] if part == "tail" else (seen[part] + 1) // 2 for part in MOST]
            found.append(Example(pairs_in(Solid(2 * depths.min(), cells, depths)), is_right([counts])))
    return found


def pairs_in(solid: Solid) -> list[Array]:
    """Return `MEASURES` (n, 5) of the pairs of each part, the largest first."""
    voted, inside = voted_limbs(votes_of(solid)), scipy.spatial.cKDTree(solid.centers)
    return [measured(pairs_of(voted, part, inside)) for part in MOST]


def is_right(bodies: Sequence[Sequence[int | None]]) -> NDArray[np.bool_]:
    """Return which of all bodies (b,) are among those that a person sees."""
    return np.array(
        [
            any(all(seen in (None, own) for seen, own in zip(body, counts, strict=True)) for body in bodies)
            for counts in load_weights()[1]
        ]
    )


def sums(example: Example, weights: Array) -> tuple[Array, Array]:
    """Return for all bodies the sums (b, 4, 6) of one and `MEASURES` over the pairs of each part, and log odds (b,)."""
    shares = load_weights()[1]
    counts, odds = np.array(list(shares)), np.array(list(shares.values()))
    found = np.zeros((len(counts), *weights.shape))
    for part, pairs in enumerate(example.pairs):
        rows = np.hstack([np.ones((len(pairs), 1)), pairs])
        for count in range(1, len(rows) + 1):
            found[counts[:, part] == count, part] = rows[:count].sum(axis=0)
        odds += ABSENT * (counts[:, part] > len(rows))
    return found, odds + np.tensordot(found, weights)


def fit(chosen: Sequence[Example]) -> Array:
    """Return the weights (4, 6) of examples: for each part its bias, then those of `MEASURES`."""

    def cost(flat: Array) -> tuple[float, Array]:
        weights = flat.reshape(START.shape)
        away = weights - START
        value, slope = STRENGTH * float((away**2).sum()), 2 * STRENGTH * away
        for each in chosen:
            table, odds = sums(each, weights)
            value += float(scipy.special.logsumexp(odds) - scipy.special.logsumexp(odds[each.right]))
            slope = slope + np.tensordot(scipy.special.softmax(odds), table, axes=1)
            slope = slope - np.tensordot(scipy.special.softmax(odds[each.right]), table[each.right], axes=1)
        return value, slope.ravel()

    found = scipy.optimize.minimize(cost, START.ravel(), method="L-BFGS-B", jac=True).x
    return np.asarray(found).reshape(START.shape)


def chances(example: Example, weights: Array) -> Array:
    """Return the probabilities (b,) of all bodies."""
    return np.asarray(scipy.special.softmax(sums(example, weights)[1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    characters, made = listed(arguments.folder), made_by_rule()
    for seed in range(ROUNDS):
        fold = np.random.default_rng(seed).permutation(len(characters)) % FOLDS
        right = 0
        for held in range(FOLDS):
            weights = fit([*(characters[row] for row in np.flatnonzero(fold != held)), *made])
            tested = [characters[row] for row in np.flatnonzero(fold == held)]
            right += sum(bool(each.right[chances(each, weights).argmax()]) for each in tested)
        print(f"held out: {right} of {len(characters)} right", flush=True)
    weights = fit([*characters, *made])
    found = [chances(each, weights) for each in characters]
    right = np.array([each.right[own.argsort()[::-1][:2]] for each, own in zip(characters, found, strict=True)])
    highest = np.array([own.max() for own in found])
    for low, high in pairwise((0.0, 0.5, 0.7, 0.9, 1.0)):
        own = (highest > low) & (highest <= high)
        print(f"probability {low:.0%} to {high:.0%}: {right[own, 0].sum()} of {own.sum()} right")
    wrong = ~right[:, 0]
    print(f"second body right: {right[wrong, 1].sum()} of {wrong.sum()} whose first is wrong")
    if arguments.write:
        write(weights)


def write(weights: Array) -> None:
    """Write the weights (4, 6) into the solver's file; how common bodies are stays."""
    text = limb_counts.WEIGHTS.read_text(encoding="utf-8")
    for part, row in zip(MOST, weights, strict=True):
        before, _, rest = text.partition(f"[{part}]\n")
        lines = [f'"{name}" = {value:.2f}' for name, value in zip(("bias", *MEASURES), row, strict=True)]
        text = "\n".join([f"{before}[{part}]", *lines, "", rest.partition("\n\n")[2]])
    limb_counts.WEIGHTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
