import tomllib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from capture.skeleton import JOINTS
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.puppet import (
    CharacterTable,
    HandleTable,
    LimbTable,
    Puppet,
    RetargetTable,
    RootTable,
    SmoothingTable,
    SolverTable,
    VrmTable,
)
from puppetline.errors import PuppetError

from ..refusals import refused
from .test_puppet import CHARACTER, PUPPET

finite = st.floats(-1e9, 1e9)

text = st.text(st.characters(codec="utf-8"), min_size=1, max_size=12)

joints = st.sampled_from(JOINTS)

axes = st.sampled_from(["", "x", "y", "z", "xy", "xz", "yz", "xyz"])

handles = st.builds(
    lambda driven, **rest: HandleTable(**rest, **driven),
    driven=st.one_of(
        st.just({}),
        joints.map(lambda name: {"joint": name}),
        st.lists(joints, min_size=1, max_size=4).map(lambda names: {"joints": names}),
    ),
    name=text,
    position=st.tuples(finite, finite, finite),
    axes=axes,
    gain=finite,
)

chains = st.integers(2, 4).flatmap(
    lambda k: st.tuples(
        st.lists(st.tuples(finite, finite, finite), min_size=k, max_size=k, unique=True),
        st.lists(joints | st.lists(joints, min_size=1, max_size=3), min_size=k, max_size=k),
    )
)

limbs = st.builds(
    lambda chain, **rest: LimbTable(points=chain[0], joints=chain[1], **rest),
    chain=chains,
    name=text,
    follow=st.sampled_from(["direction", "turn"]),
    gain=finite,
)

puppets = st.builds(
    Puppet,
    limb=st.lists(limbs, max_size=1),
    character=st.builds(
        lambda mesh, directions, scale: CharacterTable(mesh=mesh, up=directions[0], front=directions[1], scale=scale),
        text,
        st.tuples(*[st.sampled_from(["x", "-x", "y", "-y", "z", "-z"])] * 2).filter(lambda d: d[0][-1] != d[1][-1]),
        st.floats(1e-300, 1e9),
    ),
    handle=st.lists(handles, min_size=1, max_size=4, unique_by=lambda handle: handle.name),
    root=st.none() | st.builds(RootTable, joint=joints, axes=axes, turns=st.booleans()),
    retarget=st.builds(
        RetargetTable,
        mirror=st.booleans(),
        scale=st.just("auto") | st.floats(1e-300, 1e9),
        arm_space=st.floats(-90, 90),
    ),
    smoothing=st.builds(
        SmoothingTable,
        alpha=st.floats(0, 1, exclude_min=True),
        gamma=st.floats(0, 1),
        jitter_radius=st.floats(0, 1e9),
        max_deviation=st.floats(0, exclude_min=True),
        prediction=st.floats(0, 1e9),
    ),
    solver=st.builds(
        SolverTable,
        fields=st.integers(1, 64),
        isolines=st.integers(2, 10),
        iterations=st.integers(1, 1000),
        rotations=st.sampled_from(["clusters", "covariance", None]),
    ),
    vrm=st.none()
    | st.builds(
        VrmTable,
        name=text,
        authors=st.lists(text, min_size=1, max_size=3),
        licence=st.just("https://creativecommons.org/licenses/by/4.0/"),
        version=st.none() | text,
    ),
)


@given(made=puppets)
@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_puppet_that_is_written_and_read_again_is_the_same(made, tmp_path):
    puppet_file.dump(made, tmp_path / "made.toml")
    assert puppet_file.load(tmp_path / "made.toml") == made


def test_only_what_differs_from_the_defaults_is_written_and_a_root_as_a_whole():
    made = Puppet(
        character=CharacterTable(mesh="dog.glb"),
        handle=[HandleTable(name="tail", position=(0, 1, 2.5), joint="head")],
        retarget=RetargetTable(mirror=True),
        root=RootTable(),
    )
    assert tomllib.loads(puppet_file.dumps(made)) == {
        "character": {"mesh": "dog.glb"},
        "handle": [{"name": "tail", "position": [0.0, 1.0, 2.5], "joint": "head"}],
        "retarget": {"mirror": True},
        "root": {"joint": "hip_center", "axes": "xz"},
    }


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (CHARACTER + "[[handle]]\nname = tail\n", 4),
        ('[character]\nmesh = "dog.glb\n', 2),
        (CHARACTER + 'mesh = "cat.glb"\n', 3),
        (PUPPET + CHARACTER, 6),
    ],
)
def test_a_syntax_error_is_named_with_its_line(content, line):
    error = refused(PuppetError, puppet_file.loads, content, "dog.toml")
    assert error.where == "dog.toml"
    assert f"line {line}, column" in error.found


def test_a_file_that_is_a_mesh_or_no_text_or_not_there_or_nested_without_end_is_refused(blob_file, tmp_path):
    binary, deep = tmp_path / "binary.toml", tmp_path / "deep.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    deep.write_text("x = " + "[" * 50_000)
    for path in (binary, deep, tmp_path / "none.toml", tmp_path, blob_file):
        error = refused(PuppetError, puppet_file.load, path)
        assert error.where == str(path)
    assert f"puppetline new {blob_file}" in error.fix
