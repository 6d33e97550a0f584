"""TOML files that pydantic checks, with errors in terms of the file."""

import difflib
import tomllib
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from puppetline.errors import PuppetlineError, at
from puppetline.files import read_whole

EXPECTED = {
    "model_type": "a table",
    "tuple_type": "a list",
    "too_short": "a list that is not empty",
    "string_too_short": "a string that is not empty",
    "string_type": "a string",
    "int_type": "an integer",
    "bool_type": "true or false, without quotes",
}
"""What is expected after an error of pydantic, by its type, in TOML's terms; messages of other types are clear."""


Kind = Literal["puppet", "scene", "service"]
"""Kind of a TOML file."""


class Table(BaseModel):
    """A table of a file; unknown keys are errors.

    Attributes
    ----------
    file_kind : Kind or None
        Kind of the file if the table is a whole file that people may take for another.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    file_kind: ClassVar[Kind | None] = None


File = TypeVar("File", bound=Table)


def mistake(*place: str | int, found: str, expected: str, fix: str) -> PydanticCustomError:
    """Return an error for a validator to raise; `place` is relative to the validated value."""
    return PydanticCustomError("mistake", "{fix}", {"place": place, "found": found, "expected": expected, "fix": fix})


def _even(size: tuple[int, int]) -> tuple[int, int]:
    if any(side % 2 or not 16 <= side <= 7680 for side in size):
        raise mistake(
            found=f"{size[0]} × {size[1]} pixels",
            expected="an even width and height from 16 to 7680",
            fix="Write it like [1280, 720].",
        )
    return size


FilmSize = Annotated[tuple[int, int], AfterValidator(_even)]
"""Width and height of a film in pixels, which video codecs require to be even."""

FilmSet = Literal[
    "studio", "meadow", "forest", "beach", "desert", "snow", "castle", "city", "night", "stage", "space", "underwater"
]
"""Landscape or room around the characters of a film."""


def check_distinct(names: Sequence[str], kind: str) -> None:
    """Raise the error of a validator for a name that two tables of a kind, such as ``handle``, have."""
    for index, name in enumerate(names):
        if name in names[:index]:
            raise mistake(
                kind,
                index,
                "name",
                found=f"a second {kind} named {name!r}",
                expected=f"a different name for each {kind}",
                fix=f"Rename one of the two {kind}s {name!r}.",
            )


def read_text(path: Path, what: str, fix: str, family: type[PuppetlineError]) -> str:
    """Read a TOML file without changing its line ends.

    Parameters
    ----------
    path : Path
    what : str
        What the file should be, for example ``"a puppet file"``.
    fix : str
        What to do if it does not exist.
    family : type
        Class of the errors.

    Raises
    ------
    PuppetlineError
        Of that class.
    """
    try:
        return read_whole(path, what, family, fix).decode()
    except UnicodeDecodeError as error:
        raise family(
            path, found="bytes that are not text", expected="a TOML file in UTF-8", fix="Check the path."
        ) from error


def parse(text: str, where: str | Path, family: type[PuppetlineError]) -> dict[str, Any]:
    """Parse TOML; `where` names the text in errors of the class `family`.

    Raises
    ------
    PuppetlineError
        A syntax error, with its line.
    """
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:  # RecursionError: thousands of nested brackets
        raise family(
            where, found=f"a syntax error: {error}", expected="TOML", fix="Correct that line; strings require quotes."
        ) from error


def kind_of(values: dict[str, Any]) -> Kind | None:
    """Return the kind of a file by its tables; None if they do not tell."""
    if "stage" in values:
        return "service"
    characters = values.get("character")
    if isinstance(characters, list):
        return "scene"
    return "puppet" if isinstance(characters, dict) and "mesh" in characters else None


def check(model: type[File], values: dict[str, Any], where: str | Path, family: type[PuppetlineError]) -> File:
    """Return the values of a file as a model; `where` names the file in errors of the class `family`.

    Raises
    ------
    PuppetlineError
        The file is of another kind, or the first value that does not fit the model.
    """
    try:
        return model.model_validate(values)
    except ValidationError as error:
        kind = kind_of(values)
        if None not in (model.file_kind, kind) and kind != model.file_kind:
            found, expected = f"a {kind} file", f"a {model.file_kind} file"
            raise family(where, found=found, expected=expected, fix="Check the path.") from error
        raise _explained(error.errors(), model, values, where, family) from error


def _explained(
    errors: list[ErrorDetails],
    model: type[Table],
    values: dict[str, Any],
    where: str | Path,
    family: type[PuppetlineError],
) -> PuppetlineError:
    """Return the first of pydantic's errors in terms of the file."""
    # an unknown table first, because it is probably the misspelled name of a missing one
    error = next((each for each in errors if each["type"] == "extra_forbidden"), errors[0])
    location = _location(error, values)
    # a value that may be a name or a list of names has one error for each type; the one inside the list is specific
    inside = [each for each in errors if _location(each, values)[: len(location)] == location]
    error = max(inside, key=lambda each: len(_location(each, values)))
    location = _location(error, values)
    if error["type"] == "mistake":
        context = error["ctx"]
        location = [*location, *context["place"]]
        found, expected, fix = context["found"], context["expected"], context["fix"]
    elif error["type"] == "extra_forbidden":
        known = list(_model_at(model, location[:-1]).model_fields)
        close = difflib.get_close_matches(str(location[-1]), known, 1)
        found, expected = f"the unknown key {location[-1]!r}", f"one of {', '.join(known)}"
        fix = f"Did you mean {close[0]!r}?" if close else "Remove it."
    elif error["type"] == "missing" and isinstance(location[-1], int):
        location = location[:-1]
        found, expected, fix = repr(error["input"]), "three numbers", "Write it like [0.1, 1.5, 0.2]."
    elif error["type"] == "missing":
        found, expected, fix = "nothing", "a value", f"Add {_missing_name(model, location)} there."
    else:
        # a key that may have several types has an error for each of them
        kinds = [_expected(each) for each in errors if _location(each, values) == location]
        found, expected, fix = f"{error['input']!r:.80}", " or ".join(kinds), "Change the value of that key."
    return family(at(where, field=_field_name(location, model, values)), found=found, expected=expected, fix=fix)


def _location(error: ErrorDetails, values: dict[str, Any]) -> list[int | str]:
    """Return the keys and indices of an error's place, without the types that pydantic adds for unions."""
    place: list[int | str] = []
    here: Any = values
    for step in error["loc"]:
        if not isinstance(here, dict if isinstance(step, str) else list):
            continue
        place.append(step)
        here = _inside(here, step)
    return place


def _model_at(model: type[BaseModel], location: list[int | str]) -> type[BaseModel]:
    """Return the table that a place is in."""
    for step in location:
        if isinstance(step, str):
            model = _table_in(model.model_fields[step].annotation) or model
    return model


def _table_in(annotation: Any) -> type[BaseModel] | None:
    """Find the table in an annotation such as ``tuple[HandleTable, ...]`` or ``RootTable | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_table_in, typing.get_args(annotation))), None)


def _missing_name(model: type[Table], location: list[int | str]) -> str:
    """Return the name of what is missing: a key, a table or a list of tables."""
    name = str(location[-1])
    annotation = _model_at(model, location[:-1]).model_fields[name].annotation
    if _table_in(annotation) is None:
        return f"the key {name!r}"
    several = _table_in(annotation) is not annotation
    return f"a table [[{name}]]" if several else f"the table [{name}]"


def _expected(error: ErrorDetails) -> str:
    if error["type"] == "too_long":
        maximum = error["ctx"]["max_length"]
        return "three numbers" if maximum == 3 else f"at most {maximum} values"
    return EXPECTED.get(error["type"]) or _plain(error["msg"])


def _plain(message: str) -> str:
    """Turn "Input should be a valid number" into "a number", and "… greater than 0" into "a number greater than 0"."""
    text = message.removeprefix("Input should be ").replace("valid ", "")
    return f"a number {text}" if text.startswith(("greater", "less")) else text


def _field_name(location: list[Any], model: type[BaseModel], values: dict[str, Any]) -> str:
    """Return a place as it is written in the file: ``[[handle]] 2 'tail', joint``."""
    parts: list[str] = []
    here: Any = values
    for place, step in enumerate(location):
        here = _inside(here, step)
        if isinstance(step, int):
            name = f" {here['name']!r}" if isinstance(here, dict) and isinstance(here.get("name"), str) else ""
            parts[-1:] = [f"{parts[-1]} {step + 1}{name}"] if parts[-1].startswith("[[") else [parts[-1], str(step + 1)]
            continue
        annotation = model.model_fields[step].annotation if step in model.model_fields else None
        table = _table_in(annotation)
        last = place == len(location) - 1
        if table is None or last:
            parts.append(step)
        else:
            parts.append(
                f"[{step}]" if table is annotation or not isinstance(location[place + 1], int) else f"[[{step}]]"
            )
        model = table or model
    return ", ".join(parts) or "the whole file"


def _inside(value: Any, step: int | str) -> Any:
    """Return the value of a key or index, or None if there is none."""
    try:
        return value[step]
    except (TypeError, KeyError, IndexError):
        return None
