@tool
extends Control
## A figure of the performer's joints, as in a mirror. The joints that move a handle are filled. A click on a joint adds
## or removes it.

signal joint_pressed(joint: String)

const Editor := preload("editor.gd")

## Positions of the joints, from the middle and the top, in heights of the figure. The right side mirrors the left side.
const JOINT_POSITIONS := {
	"head": Vector2(0.0, 0.05),
	"shoulder_center": Vector2(0.0, 0.2),
	"spine": Vector2(0.0, 0.4),
	"hip_center": Vector2(0.0, 0.5),
	"shoulder_left": Vector2(-0.13, 0.22),
	"elbow_left": Vector2(-0.25, 0.35),
	"wrist_left": Vector2(-0.34, 0.46),
	"hand_left": Vector2(-0.39, 0.53),
	"hip_left": Vector2(-0.08, 0.54),
	"knee_left": Vector2(-0.11, 0.75),
	"ankle_left": Vector2(-0.13, 0.92),
	"foot_left": Vector2(-0.19, 0.97),
}
const BONES: Array[Array] = [
	["head", "shoulder_center", "spine", "hip_center"],
	["shoulder_center", "shoulder_left", "elbow_left", "wrist_left", "hand_left"],
	["shoulder_center", "shoulder_right", "elbow_right", "wrist_right", "hand_right"],
	["hip_center", "hip_left", "knee_left", "ankle_left", "foot_left"],
	["hip_center", "hip_right", "knee_right", "ankle_right", "foot_right"],
]

## The filled joints.
var chosen := PackedStringArray():
	set(joints):
		if chosen != joints:
			chosen = joints
			queue_redraw()

var _pointed := ""


## Return the position of a joint in this control; infinite for an unknown joint.
func joint_position(joint: String) -> Vector2:
	var left := joint.replace("_right", "_left")
	if left not in JOINT_POSITIONS:
		return Vector2(INF, INF)
	var side: Vector2 = JOINT_POSITIONS[left] * (Vector2.ONE if left == joint else Vector2(-1.0, 1.0))
	return Vector2(0.5 * size.x, 0.0) + side * size.y


func _gui_input(event: InputEvent) -> void:
	var click := event as InputEventMouseButton
	if click != null and click.pressed and click.button_index == MOUSE_BUTTON_LEFT:
		var joint := _joint_at(click.position)
		if joint:
			joint_pressed.emit(joint)
			accept_event()
	elif event is InputEventMouseMotion:
		_point(_joint_at((event as InputEventMouseMotion).position))


func _get_tooltip(at_position: Vector2) -> String:
	return _joint_at(at_position)


func _notification(what: int) -> void:
	if what == NOTIFICATION_MOUSE_EXIT:
		_point("")


func _draw() -> void:
	var line := get_theme_color("font_disabled_color", "Button")
	var filled := Editor.accent(self)
	var ground := get_theme_color("font_color", "Label")
	var width := maxf(0.012 * size.y, 1.0)
	for bone: Array in BONES:
		for i in bone.size() - 1:
			draw_line(joint_position(bone[i]), joint_position(bone[i + 1]), line, width, true)
	for joint in _joints():
		var radius := _radius() * (1.25 if joint == _pointed else 1.0)
		draw_circle(joint_position(joint), radius, filled if joint in chosen else line)
		if joint in chosen or joint == _pointed:
			draw_arc(joint_position(joint), radius, 0.0, TAU, 24, ground, width, true)
	var font := get_theme_default_font()
	var font_size := get_theme_default_font_size()
	for side: String in ["left", "right"]:
		var at := joint_position("hand_" + side) + Vector2(-0.25 * font_size, 0.09 * size.y + 0.5 * font_size)
		draw_string(font, at, side[0].to_upper(), HORIZONTAL_ALIGNMENT_LEFT, -1.0, font_size, line)


func _radius() -> float:
	return 0.026 * size.y


func _joints() -> PackedStringArray:
	var joints := PackedStringArray()
	for left: String in JOINT_POSITIONS:
		joints.append(left)
		if left.ends_with("_left"):
			joints.append(left.replace("_left", "_right"))
	return joints


## Return the joint nearest to a point; empty if none is close enough.
func _joint_at(point: Vector2) -> String:
	var nearest := ""
	var distance := 1.8 * _radius()
	for joint in _joints():
		if joint_position(joint).distance_to(point) < distance:
			nearest = joint
			distance = joint_position(joint).distance_to(point)
	return nearest


func _point(joint: String) -> void:
	if joint != _pointed:
		_pointed = joint
		mouse_default_cursor_shape = CURSOR_POINTING_HAND if joint else CURSOR_ARROW
		queue_redraw()
