"""A file that is no recording is called what it is, and the same in every command."""

import pickle
import zipfile

import pytest

from capture.formats import read_log
from capture.formats.kinds import refusal
from puppetline.errors import SkeletonLogError

CONTENTS = {
    "empty": b"",
    "pickle": pickle.dumps({"poses": [1.0]}),
    "FBX": b"Kaydara FBX Binary  \0" + bytes(99),
    "video": b"\0\0\0\x20ftypisom" + bytes(99),
    "web page": b"\n<!DOCTYPE html><html>",
    "Git LFS": b"version https://git-lfs.github.com/spec/v1\noid sha256:00\n",
    "HDF5": b"\x89HDF\r\n\x1a\n" + bytes(99),
    "Parquet": b"PAR1\x15\x04" + bytes(99),
    "companion file of macOS": b"\0\5\x16\7\0\2\0\0Mac OS X        " + bytes(99),
    "picture": b"\x89PNG\r\n\x1a\n" + bytes(99),
    "glTF": b'{"scenes": [], "nodes": [{"name": "left_elbow"}], "skins": [{"joints": [0]}], "accessors": []}',
    "glTF ": b'{"asset" : {"version": "2.0"}, "nodes": [{"name": "left_elbow"}], "skins": [{"joints": [0]}]}',
    "keys name, version": b'{"name": 1, "version": 2}',
    "columns day, open, close": b"day,open,close\n1,2,3\n2,3,4\n",
    "columns speed, weight": b"speed,weight,age\n" + 99 * b"1,2,3\n",
    "binary": bytes(range(256)) * 9,
    "right_knee_angle, velocity: angles, which give no positions": b"time,left_knee_angle,right_knee_angle,velocity\n"
    + 9 * b"1,2,3,4\n",
    "no z": b"time,left_shoulder_x,left_shoulder_y\n1,2,3\n2,3,4\n",
    "lines such as 'some notes'": b"some notes\n",
    "columns Time (s), Motion": b"Time (s),Motion\n0.0,1.5\n1.0,1.25\n2.0,1.5\n",
    "a, b, c, d, e, f, without rows of three numbers": b"a,b,c,d,e,f\n",
    "columns day, name, remark": b"day,name,remark\n1,a,b c\n2,d,e f\n3,g,h\n",
    "9 × 2 numbers in a line: positions in an image": 9
    * (b"im.png," + b",".join([b"\"['Nose', (33, 17)]\""] * 9) + b"\n"),
    "lie in a plane: positions in an image": b"".join(
        b"%d," % row + b",".join(b"%d.5,%d,0.9" % (37 * k % 101 + row, 53 * k % 97 + row) for k in range(17)) + b"\n"
        for row in range(9)
    ),
    "63 columns without names, as a hand has": 9
    * (b",".join(b"%d.5,%d,%d" % (7 * k % 11, 5 * k % 13, 3 * k % 7) for k in range(21)) + b"\n"),
    "in an image ": b"0,1,2\n" + b'"[0.1, 0.2]","[0.2, 0.3]","[0.3, 0.4]"\n' * 9,
    "20 × 2 numbers in a line: positions in an image": 9 * (b"|[" + b", ".join([b"(1.5, 2.5)"] * 20) + b"]|\n"),
    "arrays as NumPy prints them": 9 * b"[-0.71 -3.6e-01  0.44],[ 0.21 0.17 0.51]\n",
    "tensors as PyTorch prints them": 9
    * b"torch.Size([2, 3])\ntensor([[-0.1186,  0.0940,  4.4153],\n [1., 2., 3.]])\n",
    "BVH without its skeleton": b"MOTION\nFrames: 9\nFrame Time: 0.04\n" + 9 * b"0 0 0 1.5\n",
    "17 × 3 numbers in a line, the third a score: positions in an image": b"frame,keypoints\n"
    + 9 * (b'0,"[' + b", ".join([b"[0.38, 0.46, 0.04]"] * 17) + b']"\n'),
    "commas both in numbers and between them": b"Head,-0,16274,0,4911776,2,89635\n" * 9,
}


@pytest.mark.parametrize("kind", CONTENTS)
def test_the_content_tells_the_kind(tmp_path, kind):
    path = tmp_path / "take.dat"
    path.write_bytes(CONTENTS[kind])
    with pytest.raises(SkeletonLogError) as caught:
        read_log(path)
    assert kind.strip() in caught.value.found
    assert "elbow" in kind or "elbow" not in caught.value.found
    assert str(caught.value) == str(refusal(path))


@pytest.mark.parametrize(
    ("name", "line", "found"),
    [
        ("model.txt", " ".join(f"{7 * k % 11}.5" for k in range(126)), "a table with 126 columns without names"),
        ("take.bvh", "a note about a walk", "text with lines such as 'a note about a walk'"),
        ("take.BVH", " ".join(["1.5"] * 96), "a BVH without its skeleton"),
    ],
    ids=["fourteen bodies are not hands", "text is no motion", "numbers in a file with the name of a BVH are motion"],
)
def test_a_file_of_equal_lines_is_called_what_it_is(tmp_path, name, line, found):
    (tmp_path / name).write_text(9 * f"{line}\n")
    assert refusal(tmp_path / name).found.startswith(found)


@pytest.mark.parametrize(
    ("name", "kind"),
    [("a/data.pkl", "PyTorch"), ("[Content_Types].xml", "Office"), ("walk.bvh", "ZIP archive of walk.bvh")],
)
def test_an_archive_is_called_by_what_is_in_it(tmp_path, name, kind):
    with zipfile.ZipFile(tmp_path / "take", "w") as archive:
        archive.writestr(name, b"content")
    assert kind in refusal(tmp_path / "take").found


def test_points_of_a_hand_are_called_so(tmp_path):
    row = ",".join(f"{7 * k % 11},{5 * k % 13},{3 * k % 7}" for k in range(21))
    (tmp_path / "take").write_text(",".join(f"x{k},y{k},z{k}" for k in range(21)) + f"\n{row}\n{row}\n")
    with pytest.raises(SkeletonLogError, match=r"21 joints without names, .* as a hand has"):
        read_log(tmp_path / "take")
