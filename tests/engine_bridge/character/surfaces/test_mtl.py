import pytest
from PIL import Image

from engine_bridge.character.surfaces import mtl
from engine_bridge.character.surfaces.files import Folder
from engine_bridge.character.surfaces.surface import SurfaceMaterial


@pytest.fixture
def read(tmp_path):
    """Return a material and the notes about it."""
    for name, color in (("skin one.png", (9, 8, 7, 6)), ("bumps.png", (128, 128, 250)), ("heights.png", (90, 90, 90))):
        Image.new("RGBA" if len(color) == 4 else "RGB", (4, 4), color).save(tmp_path / name)

    def run(text):
        path = tmp_path / "a.mtl"
        path.write_text(f"# made by hand\nnewmtl wolf fur\n{text}\n")
        folder = Folder(tmp_path / "a.obj", [])
        (material,) = mtl.read(path, folder).values()
        assert material.name == "wolf fur"
        return material, folder.notes

    return run


def test_colours_opacity_and_glow_become_a_gltf_material(read):
    material, notes = read("Ka 1 1 1\nKd 0.1 0.2 0.3\n\tKe 0.5 0 2\nd 0.25\nillum 2\nPm 0.75")
    assert material.base_color == (0.1, 0.2, 0.3, 0.25)
    assert material.emissive == (0.5, 0, 1)
    assert (material.alpha_mode, material.metallic, material.double_sided) == ("BLEND", 0.75, False)
    assert notes == []


def rows(table):
    """Return the lines of a table, whose columns are separated by bars; semicolons stand for ends of lines."""
    lines = table.strip("\n").splitlines()
    return [[part.strip().replace("; ", "\n") for part in line.split("|")] for line in lines]


OPACITIES = """
Tr 0.25        | 0.75 | 0
d 0.5; Tr 0.1  | 0.5  | 0
d -halo 0.5    | 0.5  | 0
Tr 1           | 1    | 1
d 0            | 1    | 1
d 7            | 1    | 0
"""


@pytest.mark.parametrize(("text", "opacity", "noted"), rows(OPACITIES))
def test_opacity_is_d_or_what_tr_leaves_but_never_nothing(read, text, opacity, noted):
    material, notes = read(text)
    assert (material.base_color[3], len(notes)) == (float(opacity), int(noted))


ROUGHNESSES = f"""
                  | {SurfaceMaterial.roughness}
Ns 0              | 1
Ns 30             | 0.5
Ns 30; Ks 0 0 0   | 1
Ns 30; Ks 0.1 0 0 | 0.5
Ns 30; illum 1    | 1
Ns 30; Pr 0.25    | 0.25
Ns -3             | 1
Pr 9              | 1
"""


@pytest.mark.parametrize(("text", "roughness"), rows(ROUGHNESSES))
def test_a_phong_exponent_becomes_a_roughness(read, text, roughness):
    assert read(text)[0].roughness == pytest.approx(float(roughness))


OPTIONS = """
                                     |
-s 1 1.0 1 -o 0 0 0                  |
-clamp off -blendu off               |
-mm 0 1 -bm 1.0                      |
-S 1 -t 0 0 -texres 512 -imfchan r   |
-s 2 2 1 -o 0.5 0 0 -clamp on        | -s, -o, -clamp
-s 1 1 1 -o 0 -0.5                   | -o
-S 10                                | -S
-mm 0 0.5 -bm 0.5 -blendu off        | -mm, -bm
-t 1 1 -texres 512 -cc on            | -t, -cc
"""
"""Options of a texture, and those that are noted."""


@pytest.mark.parametrize(("options", "lost"), rows(OPTIONS))
def test_a_texture_stands_in_place_of_the_colour_and_options_that_would_change_it_are_noted(
    read, options, lost, tmp_path
):
    material, notes = read(f"Kd 0 0 0\nmap_Kd {options} skin one.png  ")
    assert material.texture.content == (tmp_path / "skin one.png").read_bytes()
    assert (material.texture.name, material.base_color) == ("skin one", (1, 1, 1, 1))
    assert [lost in note for note in notes] == [True] * bool(lost)


CUT_OUTS = """
map_Kd skin one.png; map_d skin one.png                   | MASK   |
map_Kd skin one.png                                       | OPAQUE |
d 0.5; map_Kd skin one.png; map_d skin one.png            | BLEND  |
map_Kd bumps.png; map_d skin one.png; map_Ks bumps.png    | OPAQUE | map_d map_ks
d 0.5; map_Kd bumps.png; map_d skin one.png               | BLEND  | map_d
map_Kd bumps.png; map_d bumps.png                         | OPAQUE | map_d
"""


@pytest.mark.parametrize(("text", "mode", "ignored"), rows(CUT_OUTS))
def test_the_picture_s_own_alpha_channel_cuts_out_and_another_is_ignored_with_a_note(read, text, mode, ignored):
    material, notes = read(text)
    assert material.alpha_mode == mode
    assert [name in note for name, note in zip(ignored.split(), sorted(notes), strict=True)] == [True] * len(notes)


@pytest.mark.parametrize(
    ("text", "name", "noted"),
    [
        *((f"{kind} bumps.png", "bumps", 0) for kind in ("norm", "map_Bump", "bump", "map_bump -bm 1.0")),
        ("bump heights.png\nnorm bumps.png\nmap_Bump -bm 0.5 bumps.png", "bumps", 1),
        ("map_Bump heights.png", None, 1),
    ],
)
def test_normals_are_taken_from_whatever_calls_itself_bumps_but_not_heights(read, text, name, noted):
    material, notes = read(text)
    assert (material.normal_texture and material.normal_texture.name, len(notes)) == (name, noted)


def test_lines_that_are_no_numbers_and_pictures_that_are_missing_or_elsewhere_are_noted(read, tmp_path):
    material, notes = read("Kd spectral a.rfl\nNs nan\nd\nmap_Kd none.png\nmap_Kd ../../etc/passwd")
    assert (material.base_color, material.texture) == ((1, 1, 1, 1), None)
    assert any("2 lines" in note and "line 3" in note for note in notes)
    assert any(note.startswith(f"{tmp_path / 'a.mtl'}, line 7: ") for note in notes)
