"""Fits the weights of `solver.anatomy.body_decision`, and judges them on makers that were held out.

    python -m benchmarks.body_weights FOLDER [--write]

FOLDER contains rigged characters and `labels.json`: for each character its ``file``, ``maker``, ``up``, ``front`` and
``ends``; each end has a ``class`` (head, arm, leg, wing or tail), ``joint_places`` and ``place``. Each character counts
twice: with the names of its joints, and without. Weights of labels are those of multinomial and binary logistic
regressions over the branches of the true view, weights of orientations those of a conditional one over all views. All
are drawn to those in `body_prior.toml` by a Gaussian prior.

Five times, a fifth of the makers is held out. Of the characters of those makers, the table has the shares whose up and
front are right, whose limbs are all found without a false one, and both; and how often answers of a probability are
right. With --write, the weights that were fitted to all makers replace those of the solver.
"""

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from engine_bridge.character.character import load_character
from engine_bridge.puppet.joint_graph import joint_graph
from engine_bridge.puppet.skin_joints import joints_of
from puppetline.errors import PuppetlineError
from solver.anatomy import body_decision
from solver.anatomy.body_decision import (
    ORIENTATION_MEASURES,
    PAIR_MEASURES,
    SINGLE_LABELS,
    SINGLE_MEASURES,
    View,
    Weights,
    load_weights,
    views,
)
from solver.anatomy.pair_shape import PAIR_LABELS

FOLDS = 5
PRIOR = Path(__file__).with_name("body_prior.toml")
PRIOR_DEVIATIONS, FIXED_DEVIATION = {"label": 1.0, "orientation": 2.0}, 0.1
"""Standard deviations of weights around those of the prior, and that of `CONVENTIONS`."""

CONVENTIONS = ("name", "up", "front", "sides", "stance")
"""Measures of conventions. The characters follow nearly all of them, so they cannot tell what exceptions weigh."""

AXES = {sign + axis: (-1 if sign else 1) * np.eye(3)[row] for sign in ("", "-") for row, axis in enumerate("xyz")}


@dataclass
class Example:
    """A character with or without names: its views, the true one, and true labels of the branches of the latter."""

    maker: str
    name: str
    named: bool
    views: list[View]
    true: int
    head: int
    pair_labels: list[int]
    single_labels: list[int]
    missing: int


def examples(folder: Path) -> list[Example]:
    """Return two examples for each character."""
    found = []
    for name, label in json.loads((folder / "labels.json").read_text()).items():
        try:
            joints = joints_of(load_character(folder / label["file"]))
        except PuppetlineError:
            continue
        for named in (True, False):
            own = joints if named else [replace(joint, name=str(number)) for number, joint in enumerate(joints)]
            example = _example(name, label, own, named)
            if example is not None:
                found.append(example)
    return found


def _example(name: str, label: dict, joints: list, named: bool) -> Example | None:
    made = joint_graph(joints)
    if made is None:
        return None
    graph, seen = made.graph, list(views(made.graph))
    true = next(
        number
        for number, view in enumerate(seen)
        if view.up @ AXES[label["up"]] > 0.5 and view.front @ AXES[label["front"]] > 0.5
    )
    at: dict[int, list[str]] = {}
    for end in label["ends"]:
        for place in end["joint_places"]:
            away = np.linalg.norm(graph.places - place, axis=1)
            for node in np.flatnonzero(away < 1e-3 * graph.size).tolist():
                at.setdefault(node, []).append(end["class"])
    view, used = seen[true], 0
    pair_labels = []
    for pair in view.pairs:
        sides = [{each for node in graph.subtrees[one] for each in at.get(node, ())} for one in (pair.one, pair.other)]
        both = [number for number, each in enumerate(PAIR_LABELS) if each in sides[0] & sides[1]]
        used += 2 * len(both[:1])
        pair_labels.append(both[0] if both else -1)
    single_labels = []
    for row, way in enumerate(view.branches):
        carries = any(pair_labels[number] >= 0 for number in view.beyond(row))
        own = {each for node in way for each in at.get(node, ()) if not carries}
        single_labels.append(next((number for number, each in enumerate(SINGLE_LABELS) if each in own), -1))
        used += single_labels[-1] >= 0
    head = single_labels.index(0) if 0 in single_labels else -1
    return Example(label["maker"], name, named, seen, true, head, pair_labels, single_labels, len(label["ends"]) - used)


def fit(chosen: Sequence[Example], prior: Weights) -> Weights:
    """Return the weights that fit examples best."""
    found = dict(prior)
    found |= _fit_labels(
        PAIR_LABELS, prior, [(each.views[each.true].pair_measures(each.head), each.pair_labels) for each in chosen]
    )
    found["ear"] = prior["ear"]  # the labels have no ears
    singles = [(each.views[each.true].single_measures, each.single_labels) for each in chosen]
    found |= _fit_labels(SINGLE_LABELS, prior, singles)
    tables = [np.array([view.labelled(found).measures for view in each.views]) for each in chosen]
    trues = [each.true for each in chosen]
    found["orientation"] = _minimum(
        lambda weights: _conditional(weights, tables, trues),
        prior["orientation"],
        deviations(ORIENTATION_MEASURES, "orientation"),
    )
    return found


def _fit_labels(labels: Sequence[str], prior: Weights, data: list) -> Weights:
    measures = np.concatenate([table for table, _ in data])
    wanted = np.concatenate([np.array(own, dtype=int) for _, own in data])
    start = np.concatenate([prior[label] for label in labels])
    onehot = np.eye(len(labels) + 1)[wanted][:, : len(labels)]

    def loss(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        table = weights.reshape(len(labels), -1)
        scores = np.einsum("nkm,km->nk", measures, table)
        full = np.hstack([scores, np.zeros((len(scores), 1))])
        total = scipy.special.logsumexp(full, axis=1)
        chances = np.exp(full - total[:, None])[:, : len(labels)]
        value = float((total - np.where(wanted >= 0, full[np.arange(len(full)), wanted], 0.0)).sum())
        return value, np.einsum("nk,nkm->km", chances - onehot, measures).ravel()

    names = PAIR_MEASURES if labels == PAIR_LABELS else SINGLE_MEASURES
    weights = _minimum(loss, start, np.tile(deviations(names, "label"), len(labels))).reshape(len(labels), -1)
    return dict(zip(labels, weights, strict=True))


def _conditional(weights: NDArray[np.float64], tables: list, trues: list[int]) -> tuple[float, NDArray[np.float64]]:
    value, gradient = 0.0, np.zeros_like(weights)
    for table, true in zip(tables, trues, strict=True):
        scores = table @ weights
        chances = np.exp(scores - scipy.special.logsumexp(scores))
        value -= np.log(max(chances[true], 1e-300))
        gradient += chances @ table - table[true]
    return value, gradient


def deviations(measures: Sequence[str], kind: str) -> NDArray[np.float64]:
    """Return the standard deviations of the weights of measures around the prior."""
    fixed = [name in CONVENTIONS and (kind, name) not in (("label", "front"), ("label", "up")) for name in measures]
    return np.where(fixed, FIXED_DEVIATION, PRIOR_DEVIATIONS[kind])


def _minimum(loss: Callable, prior: NDArray[np.float64], deviation: NDArray[np.float64]) -> NDArray[np.float64]:
    def penalised(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        value, gradient = loss(weights)
        away = (weights - prior) / deviation
        return value + float(away @ away) / 2, gradient + away / deviation

    return np.asarray(scipy.optimize.minimize(penalised, prior, jac=True, method="L-BFGS-B").x)


def judge(example: Example, weights: Weights) -> tuple[float, bool, bool]:
    """Return the probability of the best view, whether it is the true one, and whether all its limbs are right."""
    bodies = [view.labelled(weights) for view in example.views]
    scores = np.array([body.score for body in bodies])
    best = int(scores.argmax())
    chance = float(np.exp(scores[best] - scipy.special.logsumexp(scores)))
    view, body = example.views[example.true], bodies[example.true]
    own = {frozenset((pair.one, pair.other)): label for label, pair in body.pairs if label != "ear"}
    wanted = {
        frozenset((pair.one, pair.other)): PAIR_LABELS[number]
        for pair, number in zip(view.pairs, example.pair_labels, strict=True)
        if number >= 0
    }
    singles = {
        label: view.branches[example.single_labels.index(number)]
        for number, label in enumerate(SINGLE_LABELS)
        if number in example.single_labels
    }
    return chance, best == example.true, own == wanted and body.singles == singles and not example.missing


def text(weights: Weights, section: str) -> str:
    """Return weights as TOML."""
    rows = dict.fromkeys(PAIR_LABELS, PAIR_MEASURES) | dict.fromkeys(SINGLE_LABELS, SINGLE_MEASURES)
    rows |= {"orientation": ORIENTATION_MEASURES}
    return "\n".join(
        f"[{section}.{label}]\n"
        + "".join(f'"{name}" = {value:.2f}\n' for name, value in zip(row, weights[label], strict=True))
        for label, row in rows.items()
    )


def table(title: str, results: list[tuple[float, bool, bool]]) -> None:
    chances, axes, limbs = (np.array(column, dtype=float) for column in zip(*results, strict=True))
    print(
        f"{title:28} {len(axes):4}   axes {axes.mean():6.1%}   limbs {limbs.mean():6.1%}",
        f"  both {(axes * limbs).mean():6.1%}",
    )
    for low, high in ((0, 0.5), (0.5, 0.8), (0.8, 0.95), (0.95, 1.01)):
        within = (chances >= low) & (chances < high)
        if within.any():
            print(f"    probability {chances[within].mean():.2f}: right {axes[within].mean():.2f} of {within.sum()}")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    every, prior = examples(options.folder), load_weights("joints", PRIOR)
    makers = sorted({each.maker for each in every}, key=lambda maker: (-sum(e.maker == maker for e in every), maker))
    fold = {maker: number % FOLDS for number, maker in enumerate(makers)}
    for title, weights in (("prior", None), ("fitted, makers held out", "fit")):
        results = {}
        for number in range(FOLDS):
            own = fit([each for each in every if fold[each.maker] != number], prior) if weights else prior
            results |= {(e.name, e.named): judge(e, own) for e in every if fold[e.maker] == number}
        for named in (True, False):
            kind = "names" if named else "without names"
            table(f"{title}, {kind}", [result for (_, each), result in results.items() if each == named])
    if options.write:
        path = Path(body_decision.__file__).with_name("body_weights.toml")
        path.write_text(HEADER + text(fit(every, prior), "joints"), encoding="utf-8")


HEADER = """# Weights of the measures of solver/anatomy/body_decision.py, in logits.
# python -m benchmarks.body_weights FOLDER --write

"""

if __name__ == "__main__":
    main()
