import pickle
from pathlib import Path

import pytest

from puppetline import errors
from puppetline.errors import (
    MeshError,
    OutputError,
    PuppetError,
    PuppetlineError,
    ServiceError,
    SkeletonLogError,
    SourceError,
    at,
)

FAMILY = [SkeletonLogError, MeshError, PuppetError, SourceError, ServiceError, OutputError]


@pytest.mark.parametrize("kind", [PuppetlineError, *FAMILY])
def test_the_message_states_place_found_expected_and_fix(kind):
    error = kind(at("take.csv", line=7), found="19 numbers", expected="61 numbers", fix="Record it again.")
    assert str(error) == "take.csv, line 7: found 19 numbers; expected 61 numbers. Record it again."
    assert (error.where, error.found, error.expected) == ("take.csv, line 7", "19 numbers", "61 numbers")
    assert error.fix == "Record it again."


@pytest.mark.parametrize("kind", [PuppetlineError, *FAMILY])
def test_an_error_of_another_process_is_equal(kind):
    error = kind("take.csv", found="19 numbers", expected="61 numbers", fix="Record it again.")
    copy = pickle.loads(pickle.dumps(error))
    assert (type(copy), str(copy), vars(copy)) == (kind, str(error), vars(error))


def test_one_clause_catches_the_whole_family():
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, Exception)]
    assert set(kinds) == {PuppetlineError, *FAMILY}
    assert all(issubclass(kind, PuppetlineError) for kind in kinds)
    assert not any(issubclass(a, b) for a in FAMILY for b in FAMILY if a is not b)


@pytest.mark.parametrize("where", ["openni", "openni:"])
def test_a_source_whose_name_ends_with_a_colon_gets_no_second_one(where):
    error = SourceError(where, found="no sensor", expected="one", fix="Plug it in.")
    assert str(error) == "openni: found no sensor; expected one. Plug it in."
    assert error.where == where


def test_a_path_may_stand_for_where():
    error = MeshError(Path("models") / "dragon.glb", found="a", expected="b", fix="C.")
    assert error.where == str(Path("models") / "dragon.glb")


@pytest.mark.parametrize(
    ("arguments", "place"),
    [
        (("take.csv",), "take.csv"),
        (("take.csv", 7), "take.csv, line 7"),
        (("dog.toml", None, "handle[2].joint"), "dog.toml, handle[2].joint"),
        (("dog.toml", 3, "smoothing"), "dog.toml, line 3, smoothing"),
        ((Path("dog.toml"),), "dog.toml"),
    ],
)
def test_places_in_a_file_are_named_with_line_and_field(arguments, place):
    assert at(*arguments) == place
