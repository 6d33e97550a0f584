"""Rays and bodies that meet a character: compared with all triangles of the shown pose."""

import json

import numpy as np
import pytest
from scipy.spatial import cKDTree

from engine_bridge.export.live_basis import LiveBasis

from ..stage import performed

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
    """Return the share of a segment at which it first meets a triangle, and which."""
    start, along = ray[:3], ray[3:] - ray[:3]
    edges = corners[:, 1:] - corners[:, :1]
    system = np.concatenate([edges, np.broadcast_to(-along, (len(corners), 1, 3))], axis=1)
    u, v, t = np.linalg.solve(system.transpose(0, 2, 1), (start - corners[:, 0])[..., None])[..., 0].T
    t[~((u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1))] = np.inf
    return t.min(), t.argmin()


def check_rays(cast, stage, count, tolerance=1e-4, **settings):
    prepared = stage.character.prepared
    stage.is_playing, rays = True, random_rays(prepared.mesh, count)
    told, positions = cast(stage.port, rays, prepared.character.vertices, **settings)
    corners = positions[prepared.character.triangles]
    hits = 0
    for ray, each in zip(rays, told, strict=True):
        share, which = first_hit(corners, ray)
        assert (each["hit"] is None) == np.isinf(share)
        if each["hit"] is not None:
            hits += 1
            place = ray[:3] + share * (ray[3:] - ray[:3])
            assert np.abs(each["hit"] - place).max() <= tolerance * SCALE * stage.diagonal
            normal = np.cross(corners[which, 1] - corners[which, 0], corners[which, 2] - corners[which, 0])
            assert each["normal"] @ normal / np.linalg.norm(normal) > 1 - 10 * tolerance
            nearest = prepared.character.triangles[which, np.linalg.norm(corners[which] - place, axis=1).argmin()]
            assert each["vertex"] == (-1 if settings["mode"] == MORPHS else nearest)
    assert 0.2 * count < hits < count


@pytest.mark.parametrize(("mode", "count"), [(CONTROLS, 100), (VERTICES, 20)])
def test_rays_hit_what_is_shown(cast, stage, mode, count):
    check_rays(cast, stage, count, mode=mode)


def test_rays_hit_morph_targets_too(cast, new_stage, add_glb, blob_puppet, take, baked):
    stage = new_stage(performed(blob_puppet, take, basis=lambda prepared: LiveBasis.load(baked, prepared)))
    check_rays(cast, stage, 20, tolerance=1e-3, mode=MORPHS, mesh_source=add_glb(baked))


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
