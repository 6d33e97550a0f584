"""How calls are refused: by the place that an error names, and not by its words."""

import pytest


def refused(family, act, *arguments, **more):
    """Return the error of a call, which must be complete and of a family."""
    with pytest.raises(family) as caught:
        act(*arguments, **more)
    assert type(caught.value) is family
    assert all((caught.value.found, caught.value.expected, caught.value.fix))
    return caught.value


def refused_place(family, path, act, *arguments, **more):
    """Return what an error names behind the path of its file, without the comma between them."""
    file, found, place = refused(family, act, *arguments, **more).where.partition(str(path))
    assert (file, found) == ("", str(path))
    return place.removeprefix(", ")
