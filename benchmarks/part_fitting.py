"""Fits the weights of `solver.anatomy.part_network`.

    python -m benchmarks.part_fitting examples FOLDER EXAMPLES
    python -m benchmarks.part_fitting fit EXAMPLES WEIGHTS [--minutes N] [--without MAKER ...] [--from WEIGHTS]

`examples` poses the characters that `bodies.jsonl` and `part_examples.jsonl` list and that FOLDER contains
(`benchmarks.posed_bodies`), and makes others by rule (`benchmarks.made_bodies`). `fit` needs PyTorch, which is no
dependency of this project. Makers can be left out, so that the result is judged on characters that it has not seen.

An example is shown in many ways: some of its points, stretched, turned a little, mirrored. Three of ten stand in a
wrong way; of these only that is learned.
"""

import argparse
import json
import math
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from benchmarks.limb_finding import find, score
from benchmarks.made_bodies import PLANS, made
from benchmarks.posed_bodies import posed
from engine_bridge.character.character import load_character
from solver.anatomy.part_network import COARSE, DEPTH_SCALE, HEADS, MIDDLE, MIN_EXTENT, NEIGHBORS, PARTS, POINTS, SCALE
from solver.anatomy.voted_limbs import MIRROR

LISTS = [Path(__file__).with_name(name) for name in ("bodies.jsonl", "part_examples.jsonl")]
POSES, BODIES, FILES_PER_PLAN = 8, 10, 8
"""Number of poses of a character, of bodies in a file of those made by rule, and of such files per plan."""

CELLS = 6000
"""Number of cells that are kept of an example."""

BATCH, RATE, DECAY, AVERAGE = 16, 8e-4, 0.02, 0.998
"""Examples in a step, highest learning rate, decay of the weights, and share that their running average keeps."""

WRONG_SHARE = 0.3
"""Share of examples that stand in a wrong way."""

PART_WEIGHTS = (0.6, 1.0, 1.3, 1.0, 1.5, 1.3)
"""Weight of each part in the loss."""

TRUNK_VOTE, VOTE_WEIGHT, STANDING_WEIGHT, VOTE_SCALE = 0.3, 12.0, 0.5, 0.1
"""Weight of the votes for a trunk's joints beside those for limbs, weights of votes and standing in the loss, and
distance, in largest extents, above which the loss of a vote is linear."""

WIDTHS, LAYERS = (48, 96, 160), 4
"""Numbers of values of a point in each set, from fine to coarse, and of layers of attention."""

Array = NDArray[Any]
Arrays = dict[str, Array]


def write_examples(folder: Path, output: Path) -> None:
    """Write the examples that can be made from the files in a folder, and those that are made by rule."""
    output.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for path in LISTS for line in path.read_text(encoding="utf-8").splitlines()]
    for row in rows:
        path = folder / row["file"]
        if path.exists() and _is_read_right(row, path):
            found = list(posed(path, POSES))
            _write(output / f"{row['file'].replace('/', '+')}.npz", row["maker"], row.get("kind", "other"), found)
    for plan in PLANS:
        for number in range(FILES_PER_PLAN):
            rng = np.random.default_rng([list(PLANS).index(plan), number])
            found = [made(plan, rng) for _ in range(BODIES)]
            _write(output / f"made+{plan}{number}.npz", f"made {plan} {number}", f"made {plan}", found)


def _is_read_right(row: dict[str, Any], path: Path) -> bool:
    """Return whether the limbs of a file's skeleton are right; those in the second list were judged by eye."""
    if "ends" not in row:
        return True
    character = load_character(path)
    return score(row, character, find(character)).right[0]


def _write(path: Path, maker: str, kind: str, examples: Sequence[Any]) -> None:
    rng, arrays = np.random.default_rng(0), Arrays()
    for number, (cells, depths, limbs, parts) in enumerate(examples):
        weight = 1 / (depths + depths.min())  # as in `voted_limbs`: the least depth is half a cell
        kept = rng.choice(len(cells), min(CELLS, len(cells)), replace=False, p=weight / weight.sum())
        arrays |= {
            f"x{number}": cells[kept].astype(np.float32),
            f"d{number}": depths[kept].astype(np.float32),
            f"l{number}": limbs[kept].astype(np.uint8),
            f"c{number}": np.array([part for part, _ in parts], np.uint8),
            f"t{number}": np.array([joints for _, joints in parts], np.float32),
        }
    np.savez_compressed(path, n=len(examples), maker=maker, kind=kind, **arrays)


class Examples:
    """Examples in a folder, without those of some makers; rare makers and kinds are shown more often."""

    def __init__(self, folder: Path, without: Sequence[str]) -> None:
        self.characters: list[list[tuple[NDArray[Any], ...]]] = []
        makers, kinds = [], []
        for path in sorted(folder.glob("*.npz")):
            with np.load(path) as stored:
                if str(stored["maker"]) in without or not stored["n"]:
                    continue
                makers.append(str(stored["maker"]))
                kinds.append(str(stored["kind"]))
                numbers = range(int(stored["n"]))
                self.characters.append([tuple(stored[f"{key}{number}"] for key in "xdlct") for number in numbers])
        of_maker, of_kind = Counter(makers), Counter(kinds)
        pairs = zip(makers, kinds, strict=True)
        weight = np.array([of_maker[maker] ** -0.45 * of_kind[kind] ** -0.35 for maker, kind in pairs])
        self.share = weight / weight.sum()
        self.rng = np.random.default_rng(0)

    def one(self) -> tuple[NDArray[Any], ...]:
        """Return points, depths, lowest and highest coordinates, parts, joints, and whether it stands right."""
        rng = self.rng
        poses = self.characters[rng.choice(len(self.characters), p=self.share)]
        x, depth, limb, part, joints = poses[0 if rng.random() < 0.15 else rng.integers(len(poses))]
        kept = rng.choice(len(x), POINTS, replace=len(x) < POINTS)
        warp = np.diag(np.exp(rng.normal(0, 0.1, 3)) * (MIRROR if rng.random() < 0.5 else 1))
        if rng.random() < 0.3:
            warp = warp @ (np.eye(3) + rng.normal(0, 0.06, (3, 3)))
        right = rng.random() >= WRONG_SHARE
        warp = warp @ _about_up(np.radians(rng.normal(0, 8))) @ (np.eye(3) if right else _wrong(rng))
        points, places = x[kept].astype(float) @ warp, joints.astype(float) @ warp
        low, high = points.min(axis=0), points.max(axis=0)
        middle, size = (low + high) / 2, float((high - low).max())
        points = (points - middle) / size + rng.normal(0, 0.003, points.shape)
        own = limb[kept]
        box = np.array([(low - middle) / size, np.maximum((high - low) / size, MIN_EXTENT)])
        return (
            points,
            depth[kept] / size,
            box,
            part[own].astype(np.int64),
            (places[own] - middle) / size,
            np.array(right),
        )

    def batch(self) -> list[torch.Tensor]:
        columns = zip(*(self.one() for _ in range(BATCH)), strict=True)
        arrays = [np.stack(column) for column in columns]
        return [torch.from_numpy(each if each.dtype == np.int64 else each.astype(np.float32)) for each in arrays]


def _about_up(angle: float) -> NDArray[np.float64]:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])


def _wrong(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a turn by right angles that is none about up, or another front."""
    turns = _about_up(np.pi / 2 * int(rng.integers(1, 4)))
    if rng.random() < 0.5:
        return turns
    ups = [np.diag([1.0, -1, -1])]
    for axis, sign in ((0, 1), (0, -1), (2, 1), (2, -1)):
        up = np.eye(3)
        up[[1, axis]] = up[[axis, 1]]
        up[1] *= sign
        ups.append(up * np.linalg.det(up))
    return _about_up(np.pi / 2 * int(rng.integers(4))) @ ups[rng.integers(len(ups))]


@numba.njit(fastmath=True, parallel=True)
def _largest(
    values: Array, near: Array, x: Array, at: Array, unit: float, weight: Array, bias: Array, best: Array, chosen: Array
) -> None:
    batch, count, neighbors = near.shape
    for number in numba.prange(batch * count):
        b, n = number // count, number % count
        best[b, n] = -1e30
        for k in range(neighbors):
            j = near[b, n, k]
            way = (x[b, j] - at[b, n]) / unit
            away = np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
            for c in range(values.shape[2]):
                said = values[b, j, c] + bias[c] + weight[3, c] * away
                said += weight[0, c] * way[0] + weight[1, c] * way[1] + weight[2, c] * way[2]
                if said > best[b, n, c]:
                    best[b, n, c] = said
                    chosen[b, n, c] = j


@numba.njit(fastmath=True, parallel=True)
def _spread_back(
    gradient: Array, chosen: Array, x: Array, at: Array, unit: float, of_values: Array, of_weight: Array, of_bias: Array
) -> None:
    for b in numba.prange(gradient.shape[0]):
        for n in range(gradient.shape[1]):
            for c in range(gradient.shape[2]):
                value, j = gradient[b, n, c], chosen[b, n, c]
                way = (x[b, j] - at[b, n]) / unit
                of_values[b, j, c] += value
                of_bias[b, c] += value
                of_weight[b, 3, c] += value * np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
                for axis in range(3):
                    of_weight[b, axis, c] += value * way[axis]


class _LargestOfNeighbors(torch.autograd.Function):
    """The largest of what neighbours say. PyTorch's own gather and max take three times as long."""

    @staticmethod
    def forward(context: Any, *inputs: Any) -> torch.Tensor:
        values, weight, bias, near, x, at, unit = inputs
        shape = (*near.shape[:2], values.shape[2])
        best, chosen = np.empty(shape, np.float32), np.empty(shape, np.int32)
        where = x.contiguous().numpy(), at.contiguous().numpy(), np.float32(unit)
        own = weight.detach().t().contiguous().numpy(), bias.detach().numpy()
        _largest(values.detach().contiguous().numpy(), near.to(torch.int32).numpy(), *where, *own, best, chosen)
        context.own = chosen, where, values.shape
        return torch.from_numpy(best)

    @staticmethod
    def backward(context: Any, *gradients: torch.Tensor) -> Any:
        chosen, where, shape = context.own
        of_values = np.zeros(shape, np.float32)
        of_weight = np.zeros((shape[0], 4, shape[2]), np.float32)
        of_bias = np.zeros((shape[0], shape[2]), np.float32)
        _spread_back(gradients[0].contiguous().numpy(), chosen, *where, of_values, of_weight, of_bias)
        found = of_values, np.ascontiguousarray(of_weight.sum(axis=0).T), of_bias.sum(axis=0)
        return *(torch.from_numpy(each) for each in found), None, None, None, None


def _near(at: torch.Tensor, x: torch.Tensor, count: int) -> torch.Tensor:
    return torch.cdist(at, x).topk(count, largest=False).indices


class _Edges(nn.Module):
    def __init__(self, name: str, inner: int, outer: int, own: bool) -> None:
        super().__init__()
        self.count, self.unit = NEIGHBORS[name]
        self.a, self.p = nn.Linear(inner, outer, bias=False), nn.Linear(4, outer)
        self.q = nn.Linear(inner, outer) if own else None
        self.m, self.n = nn.Linear(outer, outer), nn.LayerNorm(outer)

    def forward(self, at: torch.Tensor, x: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
        near = _near(at, x, self.count)
        said = _LargestOfNeighbors.apply(self.a(values), self.p.weight, self.p.bias, near, x, at, self.unit)
        return self.n(self.m(functional.relu(said if self.q is None else said + self.q(values))))


class _Attention(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.n1, self.n2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.qkv, self.o = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.m = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width))

    def forward(self, tokens: torch.Tensor) -> torch.Tensor:
        batch, count, width = tokens.shape
        each = self.qkv(self.n1(tokens)).reshape(batch, count, 3, HEADS, width // HEADS).permute(2, 0, 3, 1, 4)
        seen = functional.scaled_dot_product_attention(*each).transpose(1, 2).reshape(batch, count, width)
        tokens = tokens + self.o(seen)
        return tokens + self.m(self.n2(tokens))


def _perceptron(*widths: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(*widths[:2]), nn.ReLU(), nn.Linear(*widths[1:]), nn.ReLU())


def _spread(at: torch.Tensor, x: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
    away, near = torch.cdist(at, x).topk(3, largest=False)
    share = 1 / (away + 1e-4)
    every = near + torch.arange(len(x))[:, None, None] * x.shape[1]
    found = values.flatten(0, 1).index_select(0, every.flatten()).reshape(*near.shape, -1)
    return (found * (share / share.sum(dim=-1, keepdim=True))[..., None]).sum(dim=2)


class PartNetwork(nn.Module):
    """The network of `solver.anatomy.part_network`, which can be fitted."""

    def __init__(self) -> None:
        super().__init__()
        fine, middle, coarse = WIDTHS
        self.emb = _perceptron(7, fine, fine)
        self.e0, self.e1 = _Edges("e0", fine, fine, own=True), _Edges("e1", fine, middle, own=False)
        self.e1b, self.e1c = (_Edges(name, middle, middle, own=True) for name in ("e1b", "e1c"))
        self.e2, self.pos = _Edges("e2", middle, coarse, own=False), nn.Linear(6, coarse)
        self.tok = nn.Parameter(torch.zeros(1, 1, coarse))
        self.blocks, self.n = nn.ModuleList(_Attention(coarse) for _ in range(LAYERS)), nn.LayerNorm(coarse)
        self.u1, self.u0 = _perceptron(coarse + middle, middle, middle), _perceptron(middle + fine, middle, middle)
        self.head = nn.Linear(middle, len(PARTS) + 12)
        self.glob = nn.Sequential(nn.Linear(coarse, 64), nn.ReLU(), nn.Linear(64, 5))

    def forward(self, x: torch.Tensor, depth: torch.Tensor, box: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return logits of parts (b, n, 6), places of joints (b, n, 4, 3) and logits of standing right (b,)."""
        share = SCALE * (x - box[:, :1]) / box[:, 1:] - SCALE / 2
        fine = self.emb(torch.cat([SCALE * x, DEPTH_SCALE * depth[..., None] - 1, share], dim=-1))
        fine = functional.relu(fine + self.e0(x, x, fine))
        x1, x2 = x[:, :MIDDLE], x[:, :COARSE]
        middle = functional.relu(self.e1(x1, x, fine))
        middle = functional.relu(middle + self.e1b(x1, x1, middle))
        coarse = self.e2(x2, x1, middle) + self.pos(torch.cat([SCALE * x2, share[:, :COARSE]], dim=-1))
        tokens = torch.cat([self.tok.expand(len(x), 1, -1), coarse], dim=1)
        for block in self.blocks:
            tokens = block(tokens)
        tokens = self.n(tokens)
        middle = self.u1(torch.cat([_spread(x1, x2, tokens[:, 1:]), middle], dim=-1))
        middle = functional.relu(middle + self.e1c(x1, x1, middle))
        answer = self.head(self.u0(torch.cat([_spread(x, x1, middle), fine], dim=-1)))
        joints = x[:, :, None] + answer[..., len(PARTS) :].reshape(*x.shape[:2], 4, 3)
        return answer[..., : len(PARTS)], joints, self.glob(tokens[:, 0])[:, -1]


def fit(folder: Path, output: Path, minutes: float, without: Sequence[str], begin: Path | None) -> None:
    """Fit the weights, and write their running average every hundred steps.

    If other weights were the beginning, the result is the mean of these and of the fitted ones, which is more often
    right for makers that neither has seen (Wortsman et al. 2022, "Model soups").
    """
    torch.manual_seed(0)
    examples, network, average = Examples(folder, without), PartNetwork(), PartNetwork()
    if begin is not None:
        with np.load(begin) as stored:
            network.load_state_dict({name: torch.from_numpy(stored[name].astype(np.float32)) for name in stored.files})
    average.load_state_dict(network.state_dict())
    first = {name: own.clone() for name, own in network.state_dict().items()}
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY, betas=(0.9, 0.98))
    started, steps, losses = time.monotonic(), 0, []
    while (share := (time.monotonic() - started) / (60 * minutes)) < 1:
        for group in optimizer.param_groups:
            group["lr"] = RATE * min(1.0, (steps + 1) / 150) * (0.5 + 0.5 * math.cos(math.pi * share)) + 1e-6
        loss = _loss(network, examples.batch())
        losses.append(float(loss.detach()))
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        steps += 1
        with torch.no_grad():
            for kept, own in zip(average.parameters(), network.parameters(), strict=True):
                kept.lerp_(own, 1 - min(AVERAGE, steps / (steps + 10)))
        if steps % 100 == 0:
            print(f"{steps} steps, loss {np.mean(losses):.3f}", flush=True)
            losses.clear()
            save(average, output)
    if begin is not None:
        with torch.no_grad():
            for name, own in average.state_dict().items():
                own.lerp_(first[name], 0.5)
    save(average, output)


def save(network: PartNetwork, output: Path) -> None:
    """Write weights as halves."""
    state = {name: value.numpy().astype(np.float16) for name, value in network.state_dict().items()}
    np.savez_compressed(output, **state)


def _loss(network: PartNetwork, batch: Sequence[torch.Tensor]) -> torch.Tensor:
    x, depth, box, parts, places, stands = batch
    logits, joints, standing = network(x, depth, box)
    right = stands > 0.5
    named = functional.cross_entropy(logits[right].flatten(0, 1), parts[right].flatten(), torch.tensor(PART_WEIGHTS))
    away = functional.smooth_l1_loss(joints[right], places[right], beta=VOTE_SCALE, reduction="none").sum(-1).mean(-1)
    weight = torch.where(parts[right] > 0, 1.0, TRUNK_VOTE)
    voted = (away * weight).sum() / weight.sum()
    upright = functional.binary_cross_entropy_with_logits(standing, stands)
    return named + VOTE_WEIGHT * voted + STANDING_WEIGHT * upright


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("examples", "fit"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--without", nargs="*", default=())
    parser.add_argument("--from", dest="begin", type=Path)
    options = parser.parse_args()
    if options.what == "examples":
        write_examples(options.folder, options.output)
    else:
        fit(options.folder, options.output, options.minutes, options.without, options.begin)


if __name__ == "__main__":
    main()
