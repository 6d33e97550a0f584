"""Errors say where, what was found, what was expected and what to do; other tests compare place and class only."""

import ast
import collections
import itertools
import pickle
from functools import partial
from pathlib import Path

import pytest

from puppetline import errors
from puppetline.errors import PuppetlineError, SourceError, at

from ..oracles import assert_is_part

ROOT = Path(__file__).parents[2]
KINDS = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, PuppetlineError)]
PARTS = {"found", "expected", "fix"}
ANYTHING = "\N{HORIZONTAL ELLIPSIS}"
"""Stands for values in a text that are known only when the program runs."""


class Module:
    """The calls of a module, and the texts that it gives to them."""

    def __init__(self, path):
        self.path = path
        text = path.read_text(encoding="utf-8")
        nodes = list(ast.walk(ast.parse(text))) if "Error" in text or "fix" in text else []
        self.calls = [node for node in nodes if isinstance(node, ast.Call)]
        self.classes = [node for node in nodes if isinstance(node, ast.ClassDef)]
        self.functions = [node for node in nodes if isinstance(node, ast.FunctionDef)]
        self._values = collections.defaultdict(list)
        for node in nodes:
            match node:
                case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                    pairs = zip(names, values, strict=True)
                case ast.Assign(targets=[ast.Name() as name], value=value):
                    pairs = [(name, value)]
                case _:
                    continue
            for name, value in pairs:
                self._values[_name(name)].append(value)

    def texts(self, node):
        """Return the texts that an expression may be, with `ANYTHING` for values."""
        match node:
            case ast.Constant(value=str(text)):
                return {text}
            case ast.JoinedStr(values=parts):
                return self._joined(parts)
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                return self._joined([left, right])
            case ast.IfExp(body=one, orelse=other):
                return self.texts(one) | self.texts(other)
            case ast.Name(id=name) if name in self._values:
                return set().union(*map(self.texts, self._values[name]))
        return {ANYTHING}

    def _joined(self, nodes):
        return {"".join(parts) for parts in itertools.product(*map(self.texts, nodes))}


def _name(node):
    """Return the last name of what is called or assigned to."""
    return getattr(node, "attr", getattr(node, "id", None))


@pytest.fixture(scope="module")
def product():
    """Return all modules of the product."""
    rooms = ("puppetline", "capture", "solver", "engine_bridge")
    return [Module(path) for room in rooms for path in sorted((ROOT / room).rglob("*.py"))]


def test_every_error_of_the_product_has_all_four_parts(product):
    bases = {each.name: set(map(_name, each.bases)) for module in product for each in module.classes}
    family = {"PuppetlineError"}
    while more := {name for name in bases if bases[name] & family} - family:
        family |= more
    made = set()
    for module in product:
        for call in module.calls:
            given = {keyword.arg for keyword in call.keywords}
            if _name(call.func) in family or "found" in given:
                forwards_another = given == {None} and not call.args
                assert given == PARTS or forwards_another, f"{module.path}:{call.lineno}"
                made.add(_name(call.func))
    assert made >= {kind.__name__ for kind in KINDS}


def test_every_text_of_an_error_reads_as_its_part_of_the_sentence(product):
    parameters = {
        function.name: [each.arg for each in function.args.args if each.arg not in ("self", "cls")]
        for module in product
        for function in module.functions
    }
    checked = collections.Counter()
    for module in product:
        for call in module.calls:
            by_position = zip(parameters.get(_name(call.func), ()), call.args, strict=False)
            for part, value in [*by_position, *((keyword.arg, keyword.value) for keyword in call.keywords)]:
                for text in module.texts(value) if part in PARTS else ():
                    assert_is_part(part, text, f"{module.path}:{value.lineno}")
                    checked[part] += text != ANYTHING
    assert set(checked) == PARTS


@pytest.mark.parametrize("kind", KINDS)
def test_the_message_states_the_parts_and_survives_the_way_to_another_process(kind):
    parts = {"where": "take.csv, line 7", "found": "19 numbers", "expected": "61 numbers", "fix": "Record it again."}
    error = kind(at("take.csv", line=7), **{name: parts[name] for name in PARTS})
    for each in (error, pickle.loads(pickle.dumps(error))):
        assert type(each) is kind
        assert str(each) == "take.csv, line 7: found 19 numbers; expected 61 numbers. Record it again."
        assert each.parts == vars(each) == parts


def test_no_kind_of_error_but_the_family_itself_includes_another():
    of_family = {(kind, PuppetlineError) for kind in KINDS[1:]}
    assert {(a, b) for a in KINDS for b in KINDS if a is not b and issubclass(a, b)} == {
        *of_family,
        (errors.RecordingEndError, SourceError),  # a caller that only asks whether a source goes on catches both
    }


@pytest.mark.parametrize("where", ["openni", "openni:"])
def test_a_source_whose_name_ends_with_a_colon_gets_no_second_one(where):
    error = SourceError(where, found="no sensor", expected="one", fix="Plug it in.")
    assert str(error) == "openni: found no sensor; expected one. Plug it in."
    assert error.where == where


@pytest.mark.parametrize(
    ("place", "name"),
    [
        (partial(at, "take.csv"), "take.csv"),
        (partial(at, "take.csv", 7), "take.csv, line 7"),
        (partial(at, "dog.toml", None, "handle[2].joint"), "dog.toml, handle[2].joint"),
        (partial(at, Path("dog.toml"), 3, "smoothing"), "dog.toml, line 3, smoothing"),
    ],
)
def test_places_in_a_file_are_named_with_line_and_field(place, name):
    assert place() == name
