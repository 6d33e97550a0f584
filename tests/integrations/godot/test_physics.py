"""Rays and bodies that meet a character: compared with all triangles of the shown pose."""

import json

import numpy as np
import pytest
from scipy.spatial import cKDTree

from engine_bridge.performance.rig import load_rig

CONTROLS, VERTICES, MORPHS = range(3)
SCALE = 2.0


@pytest.fixture
def cast(start_godot, tmp_path):
    """Cast rays in one pose; return the hits, and all positions in world coordinates, in the order of the scene."""

    def run(port, rays, vertices, **puppet):
        asked = {"puppet": {"port": port, **puppet}, "rays": rays.tolist(), "scale": SCALE}
        told = start_godot("rays.gd", json.dumps(asked | {"file": str(tmp_path / "shown.bin")})).finish(120)
        stored = np.fromfile(tmp_path / "shown.bin", "<f4").reshape(-1, 3).astype(float)
        rest, positions = np.split(stored, 2) if puppet.get("mode") == MORPHS else (vertices, stored)
        return told, SCALE * positions[cKDTree(rest).query(vertices)[1]]

    return run


def random_rays(mesh, count):
    """Return segments from all around the character to points in its middle, some of which miss it."""
    random = np.random.default_rng(5)
    middle, size = mesh.vertices.mean(axis=0), np.ptp(mesh.vertices, axis=0)
    away = random.normal(size=(count, 3))
    start = middle + mesh.diagonal * away / np.linalg.norm(away, axis=1, keepdims=True)
    through = middle + random.uniform(-0.5, 0.5, (count, 3)) * size
    return SCALE * np.hstack([start, start + 2 * (through - start)])


def first_hit(corners, ray):
    """Return the share of a segment at which it first meets a triangle, and which (Möller and Trumbore 1997)."""
    start, along = ray[:3], ray[3:] - ray[:3]
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    h = np.cross(along, two)
    with np.errstate(divide="ignore", invalid="ignore"):
        f = 1.0 / np.einsum("ij,ij->i", one, h)
        u = f * ((start - corners[:, 0]) * h).sum(axis=1)
        q = np.cross(start - corners[:, 0], one)
        v = f * (q @ along)
        t = f * (two * q).sum(axis=1)
    t[~((u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1))] = np.inf
    return t.min(), t.argmin()


def check_rays(cast, service, puppet, count, tolerance=1e-4, **settings):
    rig = load_rig(puppet)
    rays = random_rays(rig.mesh, count)
    told, positions = cast(service.port, rays, rig.character.vertices, **settings)
    corners = positions[rig.character.triangles]
    hits = 0
    for ray, each in zip(rays, told, strict=True):
        share, which = first_hit(corners, ray)
        assert (each["hit"] is None) == np.isinf(share)
        if each["hit"] is not None:
            hits += 1
            place = ray[:3] + share * (ray[3:] - ray[:3])
            assert np.abs(each["hit"] - place).max() <= tolerance * SCALE * rig.mesh.diagonal
            normal = np.cross(corners[which, 1] - corners[which, 0], corners[which, 2] - corners[which, 0])
            assert each["normal"] @ normal / np.linalg.norm(normal) > 1 - 10 * tolerance
            nearest = rig.character.triangles[which, np.linalg.norm(corners[which] - place, axis=1).argmin()]
            assert each["vertex"] == (-1 if settings.get("mode") == MORPHS else nearest)
    assert 0.2 * count < hits < count


def test_rays_hit_what_is_shown(cast, playing, blob_puppet, take):
    check_rays(cast, playing(blob_puppet, take), blob_puppet, 100)


def test_rays_hit_vertices_too(cast, playing, blob_puppet, take):
    check_rays(cast, playing(blob_puppet, take), blob_puppet, 20, mode=VERTICES)


def test_rays_hit_morph_targets_too(cast, playing, add_glb, blob_puppet, take, tmp_path, commands):
    commands.run("bake", blob_puppet, "-o", tmp_path / "baked.glb", "--log", take).check_returncode()
    source, service = add_glb(tmp_path / "baked.glb"), playing(blob_puppet, take, "--morphs", tmp_path / "baked.glb")
    check_rays(cast, service, blob_puppet, 20, tolerance=1e-3, mode=MORPHS, mesh_source=source)


def test_a_sphere_rests_on_a_back(start_godot, serve, make_shape, new_glb, write_puppet, sender, tmp_path):
    shape, glb = make_shape([((-0.8, 1.0, 0.0), (0.8, 1.0, 0.0), 0.35)]), new_glb()
    glb.node(glb.mesh(glb.primitive(shape.vertices, shape.faces.astype(np.uint32), NORMAL=shape.normals)))
    mesh = glb.save(tmp_path / "back.glb")
    ends = "".join(f'[[handle]]\nname = "end {x}"\nposition = [{x}, 1.0, 0.0]\n' for x in (-1.1, 1.1))
    puppet = write_puppet(tmp_path / "dog.toml", mesh.name, root=False, handles=ends)
    service = serve("--puppet", puppet, "--source", sender.uri)
    radius, back = 0.3, shape.vertices[np.abs(shape.vertices[:, 0]) < 0.3][:, 1].max()
    [told] = start_godot("drop.gd", service.port, radius, 0.0, 2.5, 0.0, 4).finish()
    assert told["collider"], told
    assert told["below"] == pytest.approx(back, abs=0.05)
    assert told["sphere"][1] == pytest.approx(back + radius, abs=0.05)
    assert told["speed"] < 0.05
