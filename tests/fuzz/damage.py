"""Kinds of damage to character files; equal random numbers cause equal damage."""

import json
import re
from copy import deepcopy

import numpy as np

from .corpus import RAW_JSON, pack, text_of, unpack

HOSTILE_VALUES = (
    *(-1, 0, 1, 2, 7, 255, 65536, 2**31, 2**32, 2**53, 2**62, 2**63, 2**64, 10**30, 10**400, -(2**63)),
    *(0.5, -0.0, 1e-320, 1e-30, 1e30, 1e39, 1e154, 1e300, -1e308),
    *(None, True, False, "", "text", "\ud800", "\0", "data:,", "..", ".", "https://a/b", "é" * 5000, "%00", "9" * 5000),
    *([], {}, [1], [[0]], [None], {"": 0}, [0] * 16, [1e300] * 16, [0] * 4, [1e-200] * 4, [1e-200] * 3, [0] * 4000),
    *(RAW_JSON + text for text in ("NaN", "-Infinity", "1e999", "9" * 4000, '{"a":1,"a":[]}', "[" * 500 + "]" * 500)),
)

OFFSETS = (-4, -1, 1, 4, 1000, 2**31, 2**63)
"""Numbers that are added to others."""

HOSTILE_FLOATS = np.array(
    [np.nan, np.inf, -np.inf, 0, -0.0, 1e-45, 1e-38, 1e-30, 1e-20, 1e18, 1e30, 3e38, -3e38, 1, -1], np.float32
)

HOSTILE_WORDS = (
    b"nan -inf 1e999 1e30 1e-30 1e-320 -0 0 -1 1 3 4 2147483648 4294967296 9223372036854775808 1_0 0x10 1/2/3 1//1 //"
    b" -99/-99/-99 999999999999999999999 1.5 . - + / # \\ v f vt vn vertex face facet endfacet loop element property"
    b" list uchar char int uint float double end_header ascii binary_little_endian OFF STL solid usemtl mtllib map_Kd"
).split(b" ")
"""Valid and invalid words for mesh files in text form."""


def damage_bytes(rng, content, others=()):
    """Flip, set, insert, delete or repeat bytes, or replace the end by that of another file, which may be empty."""
    content = bytearray(content)
    for _ in range(rng.geometric(0.6)):
        place = int(rng.integers(len(content) + 1))
        run = int(rng.integers(1, 33))
        match rng.integers(8):
            case 0:
                content[place : place + 1] = rng.choice([b"\0", b"\1", b"\n", b" ", b"-", b"0", b"9", b"\x80", b"\xff"])
            case 1:
                content[place:place] = rng.bytes(run)
            case 2:
                del content[place : place + run]
            case 3:
                content[place:place] = content[place : place + 8 * run]
            case 4 if others and rng.integers(3) == 0:
                other = others[rng.integers(len(others))]
                content[place:] = other[int(rng.integers(len(other) + 1)) :]
            case 5:
                content[place & ~3 : (place & ~3) + 4] = HOSTILE_FLOATS[rng.integers(len(HOSTILE_FLOATS))].tobytes()
            case 6:
                whole = int(rng.choice([0, 1, 3, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1])).to_bytes(4, "little")
                content[place : place + 4] = whole
            case _ if place < len(content):
                content[place] ^= 1 << int(rng.integers(8))
    return bytes(content)


def damage_words(rng, content, others=()):
    """Replace, repeat, delete or swap words of a text, or of the header of a binary file."""
    text, header_end, rest = content.partition(b"end_header")
    words = re.split(rb"(\s+)", text)
    for _ in range(rng.geometric(0.6)):
        place = min(int(rng.integers(len(words) // 2 + 1)) * 2, len(words) - 1)
        match rng.integers(5):
            case 0 | 1:
                words[place] = HOSTILE_WORDS[rng.integers(len(HOSTILE_WORDS))]
            case 2:
                words[place : place + 2] = words[place : place + 2] * int(rng.choice([2, 3, 300]))
            case 3:
                del words[place : place + 2]
            case 4:
                other = int(rng.integers(len(words) // 2)) * 2 if len(words) > 1 else 0
                words[place], words[other] = words[other], words[place]
        words = words or [b""]
    return b"".join(words) + header_end + rest


def places(value, path=()):
    """Yield the container and the key of every value in nested JSON."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in list(items):
        yield value, key
        yield from places(item)


def change_values(rng, gltf):
    """Replace, delete, repeat, copy or add to values anywhere in a description, which says where arrays are."""
    for _ in range(rng.geometric(0.6)):
        found = list(places(gltf))
        if not found:
            break
        inner, key = found[rng.integers(len(found))]
        other, elsewhere = found[rng.integers(len(found))]
        match rng.integers(8):
            case 0:
                del inner[key]
            case 1 if isinstance(inner, list):
                inner[key:key] = [deepcopy(inner[key])] * int(rng.choice([1, 2, 100]))
            case 2:
                inner[key] = deepcopy(other[elsewhere])
            case 3:
                alike = [holder[key] for holder, other in found if other == key]
                inner[key] = deepcopy(alike[rng.integers(len(alike))])
            case 4 if type(inner[key]) is int:
                inner[key] += OFFSETS[rng.integers(len(OFFSETS))]
            case 4 | 5:
                inner[key] = deepcopy(HOSTILE_VALUES[rng.integers(len(HOSTILE_VALUES))])
            case _:
                alike = [value for value in HOSTILE_VALUES if type(value) is type(inner[key])] or HOSTILE_VALUES
                inner[key] = deepcopy(alike[rng.integers(len(alike))])


def damage_values(rng, content, others=()):
    """Change the description of a .glb or .gltf."""
    is_binary = content[:4] == b"glTF"
    gltf, binary = unpack(content) if is_binary else (json.loads(content), b"")
    change_values(rng, gltf)
    return pack(gltf, binary) if is_binary else text_of(gltf)


def damage_arrays(rng, content, others=()):
    """Change the bytes after the description of a .glb, but not their number."""
    gltf, binary = unpack(content)
    return pack(gltf, damage_bytes(rng, binary)[: len(binary)].ljust(len(binary), b"\0"))


DAMAGE = {"bytes": damage_bytes, "words": damage_words, "values": damage_values, "arrays": damage_arrays}


def damage_of(name):
    """Return the kinds of damage that apply to a file."""
    ending = name.rpartition(".")[2].lower()
    if ending in ("glb", "gltf"):
        return ("bytes", "values", "arrays")[: 3 if ending == "glb" else 2]
    return ("bytes",) if name == "binary.stl" else ("bytes", "words")
