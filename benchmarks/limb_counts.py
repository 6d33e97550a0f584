"""Fits the weights of `solver.anatomy.limb_counts`, and judges them on characters that were held out.

    python -m benchmarks.limb_counts FOLDER [--write]

FOLDER contains the characters that `shapes.jsonl` lists. Each has its up and front, and the numbers of pairs of arms,
legs and wings, and of tails, that a person sees; null is any number, and some bodies may be seen in two ways. None of
these characters was shown to the network. To them come bodies that are made by rule, for plans that are rare. The
weights are those of a conditional logistic regression over all bodies, drawn to where they begin.

Three times, each fifth of the characters is held out; the first lines have the shares whose numbers are right. The
table has how often answers of a probability are right, by the weights that were fitted to all. With --write, these
replace those of the solver.
"""

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from benchmarks.made_bodies import PLANS, made
from engine_bridge.character.character import load_character
from solver.anatomy import limb_counts
from solver.anatomy.limb_counts import MEASURES, MOST, largest_first, load_weights, measured, pairs_of
from solver.anatomy.part_network import PARTS
from solver.anatomy.solid import Solid, solid_of
from solver.anatomy.standing import basis_of
from solver.anatomy.voted_limbs import voted_limbs, votes_of

SHAPES = Path(__file__).with_name("shapes.jsonl")
FOLDS, ROUNDS, STRENGTH = 5, 3, 0.3
"""Number of folds and of their random divisions, and how strongly weights are drawn to where they begin."""

MADE, LUMPS = 3, 12
"""Number of bodies that are made by rule of each plan, and of shapes without limbs."""

START = np.tile([1.0, 0.3, 0.6, 0.6, -2.0, -2.0], (len(MOST), 1))
BELOW = -50.0
"""Score of a pair that nobody voted for."""

Array = NDArray[np.float64]


@dataclass
class Example:
    """What is measured of the pairs of each part, and which bodies are right."""

    name: str
    pairs: list[Array]
    right: NDArray[np.bool_]


def examples(folder: Path) -> list[Example]:
    """Return the characters of the list that the folder contains."""
    found = []
    for row in map(json.loads, SHAPES.read_text(encoding="utf-8").splitlines()):
        if (folder / row["file"]).exists():
            mesh = load_character(folder / row["file"]).solver_mesh()
            solid = solid_of(mesh).along(basis_of(row["up"], row["front"]))
            found.append(Example(row["file"], pairs_in(solid), is_right(row["bodies"])))
    for number, plan in enumerate(PLANS):
        for body in range(LUMPS if plan == "lump" else MADE):
            cells, depths, _, limbs = made(plan, np.random.default_rng([number, body]))
            seen = Counter(PARTS[part] for part, _ in limbs)
            counts = [seen[part] if part == "tail" else (seen[part] + 1) // 2 for part in MOST]
            found.append(Example(f"made {plan}", pairs_in(Solid(2 * depths.min(), cells, depths)), is_right([counts])))
    return found


def pairs_in(solid: Solid) -> list[Array]:
    """Return what is measured of the pairs of each part."""
    voted, inside = voted_limbs(votes_of(solid)), scipy.spatial.cKDTree(solid.centers)
    found = [list(pairs_of(voted, part, inside)) for part in MOST]
    return [measured([pairs[row] for row in largest_first(pairs)]) for pairs in found]


def is_right(bodies: Sequence[Sequence[int | None]]) -> NDArray[np.bool_]:
    """Return which of all bodies a person sees."""
    return np.array(
        [
            any(all(seen in (None, own) for seen, own in zip(body, counts, strict=True)) for body in bodies)
            for counts in load_weights()[1]
        ]
    )


def sums(example: Example, weights: Array) -> tuple[Array, Array]:
    """Return the sums (b, 4, 6) of ones and measures of the likeliest pairs of all bodies, and their log odds (b,)."""
    counts = np.array(list(load_weights()[1]))
    odds = np.array(list(load_weights()[1].values()))
    found = np.zeros((len(counts), *weights.shape))
    for part, (pairs, most) in enumerate(zip(example.pairs, MOST.values(), strict=True)):
        rows = np.hstack([np.ones((len(pairs), 1)), pairs])
        best = rows[:most]
        table = np.vstack(
            [np.zeros((1, weights.shape[1])), np.cumsum(best, axis=0), np.zeros((most, weights.shape[1]))]
        )
        found[:, part] = table[counts[:, part]]
        odds = odds + BELOW * (counts[:, part] > len(best))
    return found, odds + np.tensordot(found, weights)


def fit(chosen: Sequence[Example]) -> Array:
    """Return the weights (4, 6) of one and of `MEASURES` for each part."""

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


def is_answer_right(example: Example, weights: Array) -> bool:
    return bool(example.right[sums(example, weights)[1].argmax()])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    found = examples(arguments.folder)
    for seed in range(ROUNDS):
        fold = np.random.default_rng(seed).permutation(len(found)) % FOLDS
        right = 0
        for held in range(FOLDS):
            weights = fit([each for each, own in zip(found, fold, strict=True) if own != held])
            right += sum(is_answer_right(each, weights) for each, own in zip(found, fold, strict=True) if own == held)
        print(f"held out: {right} of {len(found)} right", flush=True)
    weights = fit(found)
    chances = np.array([scipy.special.softmax(sums(each, weights)[1]).max() for each in found])
    right = np.array([is_answer_right(each, weights) for each in found])
    for low, high in ((0.0, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 1.01)):
        own = (chances >= low) & (chances < high)
        print(f"probability {low:.0%} to {min(high, 1):.0%}: {right[own].sum()} of {own.sum()} right")
    if arguments.write:
        write(weights)


def write(weights: Array) -> None:
    """Write the weights into the solver's file, below its first lines; what bodies are common stays."""
    text = limb_counts.WEIGHTS.read_text(encoding="utf-8")
    for part, row in zip(MOST, weights, strict=True):
        before, _, rest = text.partition(f"[{part}]\n")
        lines = [f'"{name}" = {value:.2f}' for name, value in zip(("bias", *MEASURES), row, strict=True)]
        text = "\n".join([f"{before}[{part}]", *lines, "", rest.partition("\n\n")[2]])
    limb_counts.WEIGHTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
