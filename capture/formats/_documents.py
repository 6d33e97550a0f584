"""Recordings whose values are nested, as one kind of document: JSON, XML and YARP's lists.

A document consists of dictionaries, lists, texts and numbers, as JSON does. An element of XML is the dictionary of its
attributes and children, of which those with the same name are a list, or else its text. A list in brackets is the
dictionary of its ``(name value)`` pairs, if it has only these. Each line of such lists is a frame.
"""

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any
from xml.parsers import expat

from capture.formats._files import HEAD_BYTES, opened
from capture.formats._json import MAX_FILE_BYTES
from capture.formats._json import load as load_json
from capture.formats._rows import read_lines
from puppetline.errors import SkeletonLogError, at

_PART = re.compile(r'[()]|"[^"]*"|[^\s()"]+')
_SYMBOLS = re.compile(rb"[\[\s]+[\\:][A-Za-z]")
_LISTS = re.compile(rb"[^\n]*\(\s*\w+\s+\(")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")

GLTF = rb'(?:\xef\xbb\xbf)?\s*\{.*"(?:accessors"|bufferViews"|asset"\s*:\s*\{)'
"""Pattern of the head of a glTF file as text, whose nodes have the names of joints too."""

MAX_DEPTH = 200
"""Largest number of levels of a document."""


def is_document(head: bytes) -> bool:
    """Return whether a file's head is that of JSON (not glTF), XML or bracketed lists."""
    start = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    is_page = re.match(rb"<(!doctype|html)", start, re.IGNORECASE) is not None
    is_marked = start[:1] in (b"{", b"[", b"<") and not is_page and _SYMBOLS.match(start) is None
    if re.match(GLTF, head, re.DOTALL):
        return False
    return is_marked or _LISTS.match(start) is not None


def load(path: Path, texts: Collection[str] | None = None) -> Any:
    """Return the document in a file; of XML, only the texts in elements of these names, which is less memory.

    Raises
    ------
    SkeletonLogError
        The file cannot be read, is too large, or violates its format.
    """
    with opened(path) as file:
        head = file.read(HEAD_BYTES).removeprefix(b"\xef\xbb\xbf").lstrip()
    if head[:1] in (b"{", b"["):
        return load_json(path).data
    return _xml(path, texts) if head[:1] == b"<" else [_lists(path, line, text) for line, text in read_lines(path)]


def _xml(path: Path, names: Collection[str] | None) -> Any:
    """Return the content of the root element of a file, without those of unknown encoding or document type."""
    root: dict[str, Any] = {}
    open_elements: list[dict[str, Any]] = [root]
    texts: list[list[str]] = [[]]
    size = 0

    def refuse(*_: Any) -> None:
        raise ValueError("a document type, which no recording needs")

    def start(_: str, attributes: dict[str, str]) -> None:
        if len(open_elements) > MAX_DEPTH:
            raise ValueError(f"more than {MAX_DEPTH} levels")
        open_elements.append({name: _value(each) for name, each in attributes.items()})
        texts.append([])

    def end(name: str) -> None:
        nonlocal size
        own, text = open_elements.pop(), "".join(texts.pop()).strip()
        value = own or (_value(text) if names is None or name in names else "")
        size += len(text) if value == text else 1
        if size > MAX_FILE_BYTES:
            raise ValueError(f"more than {MAX_FILE_BYTES} characters")
        parent = open_elements[-1]
        if name not in parent:
            parent[name] = value
        elif isinstance(parent[name], list):
            parent[name].append(value)
        else:
            parent[name] = [parent[name], value]

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = lambda text: texts[-1].append(text)
    try:
        with opened(path) as file:
            parser.ParseFile(file)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise SkeletonLogError(
            at(path, parser.CurrentLineNumber),
            found=f"XML that cannot be read ({error})",
            expected="a complete XML document",
            fix="Export the file again.",
        ) from error
    return root


def values_of(document: Any, key: str) -> Iterator[Any]:
    """Yield the values of a key in dictionaries at any depth, those of a list one by one; nothing in these values."""
    for name, value in document.items() if isinstance(document, dict) else ():
        if name == key:
            yield from value if isinstance(value, list) else [value]
        else:
            yield from values_of(value, key)
    for each in document if isinstance(document, list) else ():
        yield from values_of(each, key)


def _lists(path: Path, line: int, text: str) -> Any:
    """Return the values of a line of texts, numbers and lists in brackets."""
    levels: list[list[Any]] = [[]]
    for part in _PART.findall(text):
        if part == "(" and len(levels) <= MAX_DEPTH:
            levels.append([])
        elif part == ")" and len(levels) > 1:
            own = levels.pop()
            levels[-1].append(_pairs(own))
        elif part in "()":
            raise SkeletonLogError(
                at(path, line),
                found="brackets that do not match, or are too deep",
                expected="lists in brackets",
                fix="Delete this line, or record again.",
            )
        else:
            levels[-1].append(_value(part.strip('"')))
    values = levels[0]
    if len(values) > 2 and isinstance(values[-1], dict):  # a line's number and time precede what it has
        return {"time": values[1], **values[-1]}
    return values


def _pairs(values: list[Any]) -> Any:
    """Return the dictionary of a list's pairs of a name and a value, or the list."""
    if values and all(isinstance(each, list) and len(each) == 2 and isinstance(each[0], str) for each in values):
        return dict(values)
    return values


def _value(text: str) -> Any:
    """Return the number that a text is, or the text."""
    return float(text) if _NUMBER.fullmatch(text) else text
