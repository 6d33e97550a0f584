import numpy as np
import pytest
from PIL import Image

from engine_bridge.character.surfaces import mtl
from engine_bridge.character.surfaces.files import Folder
from engine_bridge.character.surfaces.surface import Material


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
    material, notes = read("Ka 1 1 1\nKd 0.1 0.2 0.3\n\tKe 0.5 0 2\nd 0.25\nillum 2")
    assert material.base_color == (0.1, 0.2, 0.3, 0.25)
    assert material.emissive == (0.5, 0, 1)
    assert (material.alpha_mode, material.metallic, material.double_sided) == ("BLEND", 0, False)
    assert notes == []


@pytest.mark.parametrize(
    ("text", "opacity", "noted"),
    [
        ("Tr 0.25", 0.75, 0),
        ("d 0.5\nTr 0.1", 0.5, 0),
        ("d -halo 0.5", 0.5, 0),
        ("Tr 1", 1, 1),
        ("d 0", 1, 1),
        ("d 7", 1, 0),
    ],
)
def test_opacity_is_d_or_what_tr_leaves_but_never_nothing(read, text, opacity, noted):
    material, notes = read(text)
    assert material.base_color[3] == opacity
    assert notes == ["Material 'wolf fur' would be invisible and was made opaque."] * noted


@pytest.mark.parametrize(
    ("text", "roughness"),
    [
        ("", Material.roughness), ("Ns 0", 1), ("Ns 30", 0.5), ("Ns 30\nKs 0 0 0", 1), ("Ns 30\nKs 0.1 0 0", 0.5),
        ("Ns 30\nillum 1", 1), ("Ns 30\nPr 0.25", 0.25), ("Ns -3", 1), ("Pr 9", 1),
    ],
)  # fmt: skip
def test_a_phong_exponent_becomes_a_roughness(read, text, roughness):
    assert read(text)[0].roughness == pytest.approx(roughness)


def test_pm_is_the_metallic_factor(read):
    assert read("Pm 0.75")[0].metallic == 0.75


@pytest.mark.parametrize(
    "options",
    ["", "-s 1 1.0 1 -o 0 0 0 ", "-clamp off -blendu off ", "-mm 0 1 -bm 1.0 ", "-S 1 -t 0 0 -texres 512 -imfchan r "],
)
def test_a_texture_stands_in_place_of_the_colour(read, options, tmp_path):
    material, notes = read(f"Kd 0 0 0\nmap_Kd {options}skin one.png  ")
    assert material.texture.content == (tmp_path / "skin one.png").read_bytes()
    assert (material.texture.name, material.base_color, notes) == ("skin one", (1, 1, 1, 1), [])


@pytest.mark.parametrize(
    ("options", "lost"),
    [
        ("-s 2 2 1 -o 0.5 0 0 -clamp on", "-s, -o, -clamp"), ("-s 1 1 1 -o 0 -0.5", "-o"), ("-S 10", "-S"),
        ("-mm 0 0.5 -bm 0.5 -blendu off", "-mm, -bm"), ("-t 1 1 -texres 512 -cc on", "-t, -cc"),
    ],
)  # fmt: skip
def test_options_that_would_change_a_texture_are_noted(read, options, lost, tmp_path):
    material, notes = read(f"map_Kd {options} skin one.png")
    assert material.texture.content == (tmp_path / "skin one.png").read_bytes()
    assert notes == [f"Material 'wolf fur': {lost} of map_kd ignored."]


def test_the_picture_s_own_alpha_channel_cuts_out(read):
    assert read("map_Kd skin one.png\nmap_d skin one.png")[0].alpha_mode == "MASK"
    assert read("map_Kd skin one.png")[0].alpha_mode == "OPAQUE"
    material, notes = read("map_Kd bumps.png\nmap_d skin one.png\nmap_Ks bumps.png")
    assert material.alpha_mode == "OPAQUE"
    assert sorted(notes) == ["Material 'wolf fur': map_d is ignored.", "Material 'wolf fur': map_ks is ignored."]


@pytest.mark.parametrize("kind", ["norm", "map_Bump", "bump", "map_bump -bm 1.0"])
def test_normals_are_taken_from_whatever_calls_itself_bumps(read, kind):
    material, notes = read(f"{kind} bumps.png")
    assert (material.normal_texture.name, notes) == ("bumps", [])


def test_an_opacity_map_is_noted_where_it_is_not_in_the_texture(read):
    lost = ["Material 'wolf fur': map_d is ignored."]
    material, notes = read("d 0.5\nmap_Kd bumps.png\nmap_d skin one.png")
    assert (material.alpha_mode, notes) == ("BLEND", lost)
    assert read("map_Kd bumps.png\nmap_d bumps.png")[1] == lost
    material, notes = read("d 0.5\nmap_Kd skin one.png\nmap_d skin one.png")
    assert (material.alpha_mode, notes) == ("BLEND", [])


def test_a_second_map_of_bumps_is_noted(read):
    material, notes = read("bump heights.png\nnorm bumps.png\nmap_Bump -bm 0.5 bumps.png")
    assert material.normal_texture.name == "bumps"
    assert notes == ["Material 'wolf fur': bump is ignored in favour of norm."]


def test_heights_are_noted(read):
    assert read("map_Bump heights.png")[1] == ["Material 'wolf fur': map_bump has heights and is ignored."]


def test_a_picture_that_is_missing_leaves_the_colour(read):
    material, notes = read("Kd 0.5 0.5 0.5\nmap_Kd none.png")
    assert (material.base_color, material.texture, notes) == ((0.5, 0.5, 0.5, 1), None, ["'none.png' is missing."])


def test_lines_that_are_no_numbers_are_noted(read):
    material, notes = read("Kd spectral a.rfl\nNs nan\nd")
    assert material.base_color == (1, 1, 1, 1)
    assert notes == ["a.mtl: 2 lines not understood; the first is line 3."]


def test_a_path_that_leaves_the_folder_is_noted_with_its_line(read, tmp_path):
    material, notes = read("Kd 1 0 1\nmap_Kd ../../etc/passwd")
    assert (material.base_color, material.texture) == ((1, 0, 1, 1), None)
    assert notes == [
        f"{tmp_path / 'a.mtl'}, line 4: '../../etc/passwd' is outside the mesh's folder and is not read."
        " Copy 'passwd' into that folder."
    ]


def test_materials_share_a_picture_that_both_name(tmp_path):
    Image.fromarray(np.zeros((3, 3, 3), np.uint8)).save(tmp_path / "a.tga")
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd a.tga\nnewmtl b\nmap_Kd a.tga\n")
    folder = Folder(tmp_path / "a.obj", [])
    first, second = mtl.read(tmp_path / "a.mtl", folder).values()
    assert first.texture is second.texture
    assert folder.notes == ["The image 'a.tga' is converted to PNG."]
