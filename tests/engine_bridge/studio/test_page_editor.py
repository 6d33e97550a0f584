"""The page's editor in a browser: limbs, handles, mapping, undo; every control of the left and right panels."""

import json
import shutil

import pytest

from .page_driver import running

pytestmark = pytest.mark.slow


LIMBS = {
    "trunk": ([[0.0, 0.0, 0.0], [0.0, 0.6, 0.0], [0.0, 1.2, 0.0]], ["hip_center", "spine", "shoulder_center"]),
    "head": ([[0.0, 1.25, 0.0], [0.0, 1.9, 0.25]], ["shoulder_center", "head"]),
    **{
        f"{side} arm": (
            [[sign * x, 1.12 + 0.1 * x, 0.05 * x] for x in (0.2, 0.6, 1.0, 1.35)],
            [f"{joint}_{side}" for joint in ("shoulder", "elbow", "wrist", "hand")],
        )
        for side, sign in (("left", 1), ("right", -1))
    },
    **{
        f"{side} leg": (
            [[sign * (0.1 + 0.3 * k / 2), -0.15 - 0.65 * k, 0.0] for k in (0, 1, 2)],
            [f"{joint}_{side}" for joint in ("hip", "knee", "ankle")],
        )
        for side, sign in (("left", 1), ("right", -1))
    },
}
"""The limbs of the small figure: points and joints."""


@pytest.fixture(scope="module")
def studio(tmp_path_factory, blob_file):
    """A studio with a figure of 1,478 vertices, whose edits take no time; a recording performed in the last run."""
    last_run = tmp_path_factory.mktemp("studio")
    folder = last_run / "characters" / "figure"
    folder.mkdir(parents=True)
    shutil.copy(blob_file, folder / "figure.glb")
    tables = [
        f'[[limb]]\nname = "{name}"\npoints = {points}\njoints = {json.dumps(joints)}\n'
        for name, (points, joints) in LIMBS.items()
    ]
    character = '[character]\nmesh = "figure.glb"\n'
    solver = "[solver]\nfields = 5\nisolines = 6\n"
    puppet = folder / "figure.toml"
    puppet.write_text("\n".join([character, *tables, solver]), encoding="utf-8")
    shutil.copy(puppet, folder / "live.toml")
    session = {
        "source": {"kind": "upload", "name": "walk.log"},
        "characters": [{"name": "figure", "title": "figure", "saved_file": str(puppet)}],
    }
    (last_run / "session.json").write_text(json.dumps(session), encoding="utf-8")
    with running(last_run) as running_studio:
        yield running_studio


@pytest.fixture(scope="module")
def window(studio, browser):
    """A window with the figure, which walks."""
    opened = studio.open(browser)
    opened.until("state.server?.characters.length === 1 && studio.viewer.has(state.character)")
    opened.until("state.puppets[state.character]")
    opened.idle()
    assert opened.button("Record").is_disabled()  # the recording of the last run was deleted
    opened.button("Use Walk").click()
    opened.until("state.server.source.name === 'walk' && studio.viewer.shown(state.character)?.moment")
    opened.idle()
    yield opened
    opened.close()


@pytest.fixture(autouse=True)
def _list(window):
    """Begin with the list of limbs, at rest, as the file has them."""
    undo_all(window)
    window.tab("Limbs")
    window.page.keyboard.press("Escape")
    window.button("Rest pose").click()
    window.idle()


def undo_all(window):
    for _ in range(100):
        if not window.button("Undo").is_enabled():
            return
        window.button("Undo").click()
        window.idle()
    raise AssertionError("never: everything undone")


def fill(window, label, text, **options):
    """Fill a field and leave it."""
    field = window.page.get_by_label(label, **options)
    field.fill(text)
    field.press("Tab")


def add_limb(window, *above):
    """Begin a limb with points above the end of the trunk, in pixels."""
    window.page.get_by_role("group", name="Tool").get_by_role("button", name="+ Limb").click()
    x, y = window.place("trunk", 2)
    for each in above:
        window.page.mouse.click(x, y - each)


def line(window, name):
    return window.page.locator(".panel button.line", has_text=name).first


def test_a_dragged_point_moves_in_the_view_plane_and_undo_brings_it_back(window):
    before = window.limb("left arm")["points"]
    x, y = window.place("left arm", 2)
    window.drag((x, y), (x + 30, y - 20))
    after = window.limb("left arm")["points"]
    assert after[2] != before[2]
    assert [after[0], after[1], after[3]] == [before[0], before[1], before[3]]
    assert window.place("left arm", 2) == pytest.approx((x + 30, y - 20), abs=2)
    window.button("Undo").click()
    window.idle()
    assert window.limb("left arm")["points"] == before
    window.button("Redo").click()
    window.idle()
    assert window.limb("left arm")["points"] == after


def test_a_point_dragged_along_the_surface_stays_inside_of_the_body(window):
    line(window, "left arm").click()
    window.button("Surface").click()
    before = window.limb("left arm")["points"]
    x, y = window.place("left arm", 1)
    nx, ny = window.place("left arm", 2)
    window.drag((x, y), ((x + nx) / 2, (y + ny) / 2))
    bounds = window.page.evaluate("studio.viewer.bounds(studio.state().character)")
    moved = window.limb("left arm")["points"][1]
    assert moved != before[1]
    assert all(low <= value <= high for value, low, high in zip(moved, *bounds, strict=True))
    window.button("View plane").click()


def test_arrow_keys_move_the_selected_point_and_delete_removes_it(window):
    line(window, "left arm").click()
    window.button("Point 2").click()
    before = window.limb("left arm")["points"]
    window.page.locator(".overlay").focus()
    window.page.keyboard.press("ArrowUp")
    window.idle()
    assert window.limb("left arm")["points"][1][1] > before[1][1]
    window.page.keyboard.press("Delete")
    window.idle()
    assert len(window.limb("left arm")["points"]) == len(before) - 1
    window.page.keyboard.press("Control+z")
    window.idle()
    window.page.keyboard.press("Control+Shift+Z")
    window.idle()
    assert len(window.limb("left arm")["points"]) == len(before) - 1
    window.page.keyboard.press("Control+z")
    window.idle()
    window.page.keyboard.press("Control+y")
    window.idle()
    assert len(window.limb("left arm")["points"]) == len(before) - 1
    window.page.keyboard.press("Control+z")
    window.page.keyboard.press("Control+z")
    window.idle()
    assert window.limb("left arm")["points"] == before


def test_a_joint_moves_the_limb_that_is_clicked_after_it(window):
    window.page.locator("#joint-foot_right").click()
    assert window.state("joint") == "foot_right"
    line(window, "left arm").click()
    window.idle()
    assert window.limb("left arm")["joints"] == ["hip_right", "knee_right", "ankle_right", "foot_right"]


def test_a_joint_and_a_tool_are_put_back(window):
    window.page.locator("#joint-head").click()
    window.page.locator(".tool-hint").get_by_role("button", name="Cancel").click()
    assert window.state("joint") is None
    tools = window.page.get_by_role("group", name="Tool")
    for tool in ("+ Limb", "+ Handle"):
        for back in (window.button("Cancel"), tools.get_by_role("button", name="Select")):
            tools.get_by_role("button", name=tool).click()
            assert window.state("tool") != "select"
            back.click()
            assert window.state("tool") == "select"


def test_a_joint_moves_the_point_that_was_selected_before_it(window):
    line(window, "left arm").click()
    window.button("Point 4").click()
    window.page.locator("#joint-head").press("Enter")
    window.idle()
    assert window.limb("left arm")["joints"][3] == "head"


def test_joints_are_reached_by_arrow_keys(window):
    window.page.locator("#joint-head").focus()
    window.page.keyboard.press("ArrowDown")
    assert window.page.evaluate("document.activeElement.id") == "joint-shoulder_center"


def test_name_follow_gain_and_parent_of_a_limb_can_be_changed(window):
    line(window, "left arm").click()
    window.page.get_by_label("Name").fill("left flipper")
    window.page.get_by_label("Name").press("Enter")
    window.page.get_by_label("It copies").select_option("turn")
    fill(window, "How far it moves", "1.5")
    window.page.get_by_label("Grows out of").select_option("head")
    window.page.get_by_label("Your joint for point 1").select_option("spine")
    window.idle()
    limb = window.limb("left flipper")
    assert (limb["follow"], limb["gain"], limb["parent"], limb["joints"][0]) == ("turn", 1.5, "head", "spine")
    undo_all(window)
    assert window.limb("left arm")["gain"] == 1.0


def test_points_can_be_added_and_removed(window):
    line(window, "left arm").click()
    count = len(window.limb("left arm")["points"])
    window.button("Point 1").click()
    x, y, z = window.limb("left arm")["points"][0]
    fill(window, "Place, y", f"{y + 0.05:.3f}")
    window.idle()
    assert window.limb("left arm")["points"][0] == [x, round(y + 0.05, 3), z]
    window.button("Add point").click()
    window.idle()
    assert len(window.limb("left arm")["points"]) == count + 1
    window.button("Remove point").click()
    window.idle()
    assert len(window.limb("left arm")["points"]) == count


def test_a_deleted_limb_comes_back_as_a_copy_of_the_other_side(window):
    line(window, "right arm").click()
    window.button("Delete right arm").click()
    window.idle()
    assert "right arm" not in [limb["name"] for limb in window.puppet["limb"]]
    line(window, "left arm").click()
    window.button("Copy to other side").click()
    window.idle()
    left, right = window.limb("left arm"), window.limb("right arm")
    assert right["joints"] == [joint.replace("left", "right") for joint in left["joints"]]
    trunk = next(limb for limb in window.puppet["limb"] if limb["name"] == "trunk")["points"]
    middle = sum(point[0] for point in trunk) / len(trunk)
    for a, b in zip(left["points"], right["points"], strict=True):
        assert b == pytest.approx([2 * middle - a[0], a[1], a[2]], abs=1e-6)


def test_a_handle_is_added_where_the_surface_is_clicked_and_mapped_tuned_and_deleted(window):
    window.button("+ Handle").click()
    window.page.mouse.click(*window.place("trunk", 1))
    window.idle()
    assert window.state("selection") == {"kind": "handle", "name": "handle"}
    window.page.get_by_label("What moves it").select_option("hand_left")
    for axis in ("to the sides", "up and down"):
        window.page.get_by_label(axis).uncheck()
        window.page.get_by_label(axis).check()
    window.page.get_by_label("forwards and back").uncheck()
    fill(window, "How far it moves", "2")
    window.idle()
    handle = window.handle("handle")
    assert (handle["joint"], handle["axes"], handle["gain"]) == ("hand_left", "xy", 2.0)
    for axis, value in zip("xyz", handle["position"], strict=True):
        fill(window, f"Place, {axis}", f"{value + 0.05:.3f}")
    window.idle()
    assert window.handle("handle")["position"] == [round(value + 0.05, 3) for value in handle["position"]]
    window.page.locator(".overlay").focus()
    window.page.keyboard.press("Backspace")
    window.idle()
    assert window.puppet["handle"] == []
    window.button("Undo").click()
    window.idle()
    line(window, "handle").click()
    window.button("Delete handle").click()
    window.idle()
    assert window.puppet["handle"] == []


def test_a_limb_is_added_by_clicking_its_points(window):
    window.page.get_by_role("group", name="Tool").get_by_role("button", name="+ Limb").click()
    window.page.mouse.click(*window.place("right leg", 1))
    (x, y) = window.place("right leg", 2)
    window.page.mouse.click(x, y - 12)
    assert window.button("Finish limb").is_enabled()
    window.button("Cancel").click()
    assert window.state("drawn") == []
    count = len(window.puppet["limb"])
    line(window, "head").click()
    window.button("Delete head").click()
    window.idle()
    add_limb(window, 15, 40)
    window.button("Finish limb").click()
    window.idle()
    assert len(window.puppet["limb"]) == count
    assert len(window.limb("limb")["points"]) == 2
    window.button("Undo").click()
    window.idle()
    add_limb(window, 15, 40)
    window.page.keyboard.press("Enter")
    window.idle()
    assert len(window.limb("limb")["points"]) == 2


def test_the_settings_of_the_whole_body(window):
    window.tab("Motion")
    window.page.get_by_label("Like a mirror").check()
    window.page.get_by_label("Hands meet").uncheck()
    window.page.get_by_label("How far handles go: automatic").uncheck()
    fill(window, "How far handles go", "1.5", exact=True)
    window.page.get_by_label("Room under the arms").fill("10")
    window.page.get_by_label("Room under the arms").press("ArrowRight")
    window.idle()
    retarget = window.puppet["retarget"]
    assert retarget == {"mirror": True, "hands_meet": False, "scale": 1.5, "arm_space": 11}


def test_walking(window):
    window.tab("Motion")
    walks = window.page.get_by_label("It walks when you walk")
    if not walks.is_checked():
        walks.check()
    window.page.get_by_label("It turns when you turn").uncheck()
    window.page.get_by_label("Feet stand on the floor").uncheck()
    window.page.get_by_label("Where it can walk").select_option("xyz")
    window.idle()
    root = window.puppet["root"]
    assert (root["turns"], root["feet"], root["axes"]) == (False, "free", "xyz")
    walks.uncheck()
    window.idle()
    assert window.puppet["root"] is None


def test_a_preset_of_smoothing_changes_the_plot_and_its_numbers(window):
    window.tab("Motion")
    before = window.until("state.preview?.jitter_mm")
    window.page.get_by_label("How smooth?").select_option("very")
    window.idle()
    window.until(f"state.preview?.jitter_mm < {before}")
    window.page.get_by_label("Shaking").get_by_text("Details").click()
    assert window.state("preview")["lag_ms"] > 50
    assert window.puppet["smoothing"]["alpha"] == 0.3
    assert "mm of 5 mm jitter left" in window.page.locator("figcaption").inner_text()
    window.page.get_by_label("Response").fill("0.9")
    window.page.get_by_label("Response").press("ArrowRight")
    window.idle()
    assert window.puppet["smoothing"]["alpha"] == 0.95
    assert window.page.get_by_label("How smooth?").input_value() == "custom"
    sliders = {
        "Trend": ("gamma", 0.35),
        "Jitter radius, m": ("jitter_radius", 0.03),
        "Deviation, m": ("max_deviation", 0.07),
        "Prediction, frames": ("prediction", 0.4),
    }
    for label, (_, value) in sliders.items():
        window.page.get_by_label(label).fill(str(value))
    window.idle()
    assert {key: window.puppet["smoothing"][key] for key, _ in sliders.values()} == dict(sliders.values())


def test_tabs_are_reached_by_arrow_keys(window):
    window.tab("Limbs")
    window.page.keyboard.press("ArrowRight")
    assert window.state("tab") == "motion"
    assert window.page.evaluate("document.activeElement.id") == "tab-motion"
    window.page.keyboard.press("ArrowLeft")
    assert window.state("tab") == "limbs"


def test_bones_can_be_hidden_and_the_view_fitted(window):
    bones = window.page.get_by_label("Bones")
    bones.uncheck()
    window.until("studio.viewer.places().limbs.length === 0")
    bones.check()
    before = window.place("head", 1)
    box = window.page.locator(".overlay").bounding_box()
    window.page.mouse.move(box["x"] + 40, box["y"] + 40)
    window.page.mouse.wheel(0, 600)
    moved = "studio.viewer.places().limbs.find(({ name }) => name === 'head').points[1][1]"
    window.until(f"Math.abs({moved} - {before[1] - box['y']}) > 5")
    assert window.place("head", 1) != pytest.approx(before, abs=5)
    window.button("Fit").click()
    assert window.place("head", 1) == pytest.approx(before, abs=1)


def test_the_puppet_file_is_saved_and_downloaded(window):
    line(window, "left arm").click()
    fill(window, "How far it moves", "1.25")
    window.idle()
    window.until("!state.server.characters[0].saved")
    window.page.get_by_text("Unsaved changes").wait_for()
    with window.page.expect_download() as download:
        window.button("Save the character").click()
    assert "gain = 1.25" in download.value.path().read_text()
    window.until("state.server.characters[0].saved")
    window.page.get_by_label("How far it moves").fill("1")
    with window.page.expect_download() as download:
        window.page.get_by_label("How far it moves").press("Tab")
        window.idle()
        window.page.keyboard.press("Control+s")
    assert "gain = 1.25" not in download.value.path().read_text()
    window.until("state.server.characters[0].saved")


def test_the_mesh_is_stood_up_and_turned_round(window):
    window.tab("Motion")
    height = "(([low, high]) => high.y - low.y)(Object.values(studio.viewer.boxes())[0])"
    before = window.page.evaluate(height)
    window.page.get_by_label("Which way is up?").select_option("z")
    window.idle()
    assert window.puppet["character"] | {"mesh": ""} == {"mesh": "", "up": "z", "front": "y", "scale": 1.0}
    window.until(f"Math.abs({height} - ({before})) > 0.1")
    window.page.get_by_label("Which way does it look?").select_option("-x")
    window.idle()
    assert window.puppet["character"]["front"] == "-x"
    undo_all(window)
    window.until(f"Math.abs({height} - ({before})) < 1e-6")


def test_the_plot_shows_a_live_joint_of_the_performer(window):
    window.tab("Motion")
    window.page.get_by_label("Shaking").get_by_text("Details").click()
    window.page.get_by_role("combobox", name="Plot of").select_option("hand_left")
    live = window.until(
        "state.preview !== null && state.plotted === 'hand_left' && state.preview.times.at(-1) > 1 && state.preview"
    )
    assert live["rise_ms"] is None
    assert len(live["times"]) == len(live["measured"]) == len(live["smoothed"])
    assert "the left hand in the last seconds" in window.page.locator("svg.plot").get_attribute("aria-label")
    window.page.get_by_role("combobox", name="Plot of").select_option("")
    window.until("state.preview?.rise_ms !== null && state.preview?.measured_mm === 5")


def test_the_list_is_reached_from_a_part_and_the_motion_from_the_rest_pose(window):
    line(window, "left leg").click()
    window.button("‹ All limbs and handles").click()
    assert window.state("selection") is None
    window.button("Live").click()
    frame = window.until("studio.viewer.moment(state.character)?.later")
    window.until(f"studio.viewer.moment(state.character).later > {frame}")
    window.button("Rest pose").click()
    window.until("studio.viewer.moment(state.character) === null")


def test_the_other_characters_are_offered_and_the_way_back(window):
    window.page.get_by_label("Character", exact=True).select_option(label="Open another…")
    assert window.button("Human").is_enabled()
    window.button("Back to the character").click()
    window.button("+ Limb").wait_for()


def test_a_character_is_closed(window):
    window.page.get_by_role("button", name="Close figure").click()
    window.until("state.server.characters.length === 0")
    window.page.get_by_role("heading", name="Choose a character, and it moves as you do.").wait_for()
