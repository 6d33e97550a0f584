"""What a file is that is no recording, by its content, and what would work instead."""

import re
import zipfile
from pathlib import Path

from capture.formats._cells import number
from capture.formats._columns import of_angles
from capture.formats._documents import GLTF
from capture.formats._files import HEAD_BYTES, opened
from capture.formats._json import load
from capture.formats._rows import head_lines, whole_lines
from capture.formats._table import EXPORT, IN_SPACE, NAME_COLUMNS, ROWS, Table
from capture.formats.landmarks_json import described
from capture.formats.options import ReadOptions
from puppetline.errors import SkeletonLogError

MIN_POINTS = 6
"""Number of points, or of names of columns, in a line from which they are those of a body."""

EXPECTED = "a recording of a person's joints: BVH, a table, an array, JSON of a tracker or sensor, or a take"
"""What `puppetline` reads, for messages."""

_AS_NUMBERS = "In Python, save the joints as numbers: np.savez(path, joints=…), or an SMPL body's poses and trans."
_NUMBER = rb"\s*-?\d[\d.]*(?:e[-+]?\d+)?\s*"
_POINT = re.compile(rb"\[(%b(?:[,\s]%b)+)\]" % (_NUMBER, _NUMBER))
_IN_SQUARES = bytes.maketrans(b"()", b"[]")
_VIDEO = rb".{4}ftyp|\x00\x00\x01\xba|RIFF....AVI |\x1aE\xdf\xa3|FLV\x01"
_KINDS: tuple[tuple[bytes, str, str], ...] = (
    (rb"\x80[\x02-\x05]", "a pickle of Python objects, which can run any program when it is read", _AS_NUMBERS),
    (
        rb"\x89HDF\r\n",
        "an HDF5 file (.h5, or MATLAB 7.3)",
        "In MATLAB, save -v7; in Python, save arrays with np.savez.",
    ),
    (rb"Kaydara FBX Binary|; FBX", "an FBX file", "In Blender, import it and export the motion as BVH."),
    (_VIDEO, "a video", ""),
    (rb"version https://git-lfs", "a Git LFS pointer instead of the file", "Download the file itself: git lfs pull."),
    (rb"[/.]*/?annex/objects", "a git-annex pointer instead of the file", "Download the file itself: git annex get."),
    (rb"\s*<(?i:!doctype html|html)", "a web page", "Download the file itself: the link to a raw file."),
    (rb"\s*<(?i:\?xml|[a-z]+[ >])", "an XML file", EXPORT),
    (rb"\x1f\x8b|7z\xbc\xaf|Rar!|BZh|\xfd7zXZ", "a compressed file", "Unpack it, and use the file inside."),
    (rb"\x89PNG|\xff\xd8\xff|GIF8|BM|RIFF....WEBP", "a picture", "Use a recording, or a video of a performer."),
    (rb"RIFF....WAVE|ID3|OggS|fLaC", "a sound", "Use a recording of joints, or a video of a performer."),
    (rb'"?\[+\s*-?[\d.]+(e[-+]?\d+)?\s+-?[\d.]', "arrays as NumPy prints them", _AS_NUMBERS),
    (rb"torch\.Size\(|tensor\(", "tensors as PyTorch prints them", _AS_NUMBERS),
    (rb"glTF|" + GLTF, "a glTF file", "Use it as a character; export its motion as BVH to use it as a recording."),
    (rb"\xd0\xcf\x11\xe0", "an Office file", "Save the sheet as CSV."),
    (rb"%PDF", "a PDF", EXPORT),
    (rb"PAR1", "a Parquet file", "In Python, write it as a table: pandas.read_parquet(path).to_csv(…)."),
    (rb"SQLite format 3", "an SQLite database", EXPORT),
    (rb"\x00\x05\x16\x07", "a companion file of macOS, without the recording", "Use the file without ._ in its name."),
)


def refusal(path: Path) -> SkeletonLogError:
    """Return the error for a file that is no recording: what it is, and the nearest thing that would work.

    Raises
    ------
    SkeletonLogError
        The file cannot be read.
    """
    with opened(path) as file:
        head = file.read(HEAD_BYTES)
    found, fix = _describe(path, head)
    return SkeletonLogError(path, found=found, expected=EXPECTED, fix=fix)


def is_video(path: Path) -> bool:
    """Return whether a file is a video.

    Raises
    ------
    SkeletonLogError
        The file cannot be read.
    """
    with opened(path) as file:
        return re.match(_VIDEO, file.read(16), re.DOTALL) is not None


def _describe(path: Path, head: bytes) -> tuple[str, str]:
    if not head:
        return "an empty file", "Record again."
    if head.startswith(b"PK\3\4"):
        return _archive(path)
    for pattern, found, fix in _KINDS:
        if re.match(pattern, head, re.DOTALL):
            record = f"puppetline record --source video:{path.name} -o take.log"
            return found, fix or f"Use it in puppetline convert or animate, or record the performer in it: {record}."
    if b"\0" in head or _is_binary(head):
        return "a binary file of an unknown kind", EXPORT
    if head.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"["):
        return _json(path), "Export x, y and z of the joints in each frame, with their names."
    is_numbers = path.suffix.lower() == ".bvh" and re.match(rb"[\s\d.eE+-]+\Z", head[:1000])
    if is_numbers or re.match(rb"\s*(motion\s+)?frames\s*:", head, re.IGNORECASE):
        return "a BVH without its skeleton", "Copy the whole file: it begins with the word HIERARCHY."
    return _text(path, head)


def _text(path: Path, head: bytes) -> tuple[str, str]:
    """Return what a text is, by its lines, and what to do."""
    if found := _in_image(head.translate(_IN_SQUARES)):
        return found, IN_SPACE
    try:
        _ = Table(path, whole_lines(head), ReadOptions()).layouts
    except SkeletonLogError as error:
        place = error.where.removeprefix(str(path)).removeprefix(", ")
        if place:
            return f"a table in which {place} has {error.found} instead of {error.expected}", EXPORT
        if error.expected != ROWS:
            return error.found, error.fix
    else:
        return "a table of positions that are no person's", EXPORT
    first, *others = (line.strip() for line in head_lines(head, 60))
    rows = [re.split("[,;\t|]", line) for line in (first, *others)]
    is_table = len(rows[0]) >= MIN_POINTS or (len(rows) > 2 and {len(rows[0])} == {*map(len, rows[:-1])} != {1})
    if is_table and not any(number(cell) is not None for cell in rows[0] if cell):
        listed = f"{', '.join(rows[0][:12])}{' …' if len(rows[0]) > 12 else ''}{of_angles(rows[0])}"
        return f"a table with the columns {listed}, without rows of three numbers", f"{EXPORT} {NAME_COLUMNS}"
    return f"text with lines such as {first[:60]!r}{'…' if len(first) > 60 else ''}", EXPORT


def _in_image(text: bytes) -> str:
    """Return what a text is whose lines have points with two numbers, or with a score as the third; "" for others."""
    for line in text.splitlines()[:20]:
        points = [re.split(rb"\s*,\s*|\s+", point.strip()) for point in _POINT.findall(line)]
        size = len(points[0]) if len({*map(len, points)}) == 1 and len(points) >= MIN_POINTS else 0
        if size == 2:
            return f"a table with {len(points)} × 2 numbers in a line: positions in an image"
        if size == 3 and all(re.fullmatch(rb"0?\.\d+|[01](\.0*)?", point[-1]) for point in points):
            return f"a table with {len(points)} × 3 numbers in a line, the third a score: positions in an image"
    return ""


def _is_binary(head: bytes) -> bool:
    text = head[:-3].decode("utf-8", errors="replace")
    return text.count("\ufffd") > len(text) / 100


def _archive(path: Path) -> tuple[str, str]:
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return "a damaged ZIP archive", "Download it again."
    if any(name.endswith("data.pkl") for name in names):
        return "a PyTorch file, which can run any program when it is read", _AS_NUMBERS
    if "[Content_Types].xml" in names:
        return "an Office file", "Save the sheet as CSV."
    return f"a ZIP archive of {', '.join(names[:5])}", "Unpack it, and use the file inside."


def _json(path: Path) -> str:
    try:
        document = load(path).data
    except SkeletonLogError as error:
        return error.found
    return f"JSON{described(document)[0]}"
