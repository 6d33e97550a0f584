@tool
@icon("icons/puppet_attachment_3d.svg")
class_name PuppetAttachment3D
extends Node3D
## Follows a point of a [Puppet3D], so that its children stay on the moving character: hats, props, lights, sounds.
##
## Choose a vertex of the surface, a handle or a limb. The y axis of the node points out of the surface or along the
## limb, and its z axis to the front of the character at rest. The node is never scaled.

const SurfacePatch := preload("play/surface_patch.gd")
const Scene := preload("wire/scene.gd")

## The character to follow. If empty, the parent.
@export var puppet: Puppet3D:
	set(value):
		puppet = value
		_follow()
## Number of a vertex of the character's scene; −1 for none. In the editor, turn on *Pick Vertex* in the toolbar of the
## 3D view and click the character.
@export var vertex := -1:
	set(value):
		vertex = value
		_reset()
## Name of a handle, whose position on the surface is followed if there is no [member vertex].
@export var handle := "":
	set(value):
		handle = value
		_reset()
## Name of a limb, which is followed if there is neither a [member vertex] nor a [member handle].
@export var limb := "":
	set(value):
		limb = value
		_reset()
## Position along the limb: 0 at its root, 1 at its tip.
@export_range(0.0, 1.0, 0.01) var limb_position := 1.0:
	set(value):
		limb_position = value
		_reset()
## Whether the node turns with the surface. If not, it has the rotation of the character.
@export var follow_rotation := true
## Transform from the followed point.
@export var offset := Transform3D.IDENTITY

var _followed: Puppet3D
var _patch: SurfacePatch  # null until the scene is known


func _enter_tree() -> void:
	_follow()


func _exit_tree() -> void:
	_unfollow()


func _get_configuration_warnings() -> PackedStringArray:
	if _followed == null:
		return ["No character to follow. Set puppet, or put the node below a Puppet3D."]
	if vertex < 0 and handle.is_empty() and limb.is_empty():
		return ["No point to follow. Set vertex, handle or limb."]
	if _followed.get_character_scene() != null and _patch == null:
		return ["The character '%s' does not have this point." % _followed.statistics()["character"]]
	return []


## Return the character that is followed; null if there is none.
func get_followed() -> Puppet3D:
	return _followed


## Offer the names of handles and limbs.
func _validate_property(property: Dictionary) -> void:
	var scene := _followed.get_character_scene() if _followed != null else null
	if scene != null and property["name"] in [&"handle", &"limb"]:
		var named: Array = scene.handles if property["name"] == &"handle" else scene.limbs
		property["hint"] = PROPERTY_HINT_ENUM_SUGGESTION
		property["hint_string"] = ",".join(named.map(func(each: Dictionary) -> String: return each["name"]))


func _follow() -> void:
	_unfollow()
	_followed = puppet if puppet != null else get_parent() as Puppet3D
	if _followed != null and is_inside_tree():
		_followed.scene_loaded.connect(_reset)
		_followed.pose_updated.connect(_move)
	_reset()


func _unfollow() -> void:
	if is_instance_valid(_followed) and _followed.pose_updated.is_connected(_move):
		_followed.scene_loaded.disconnect(_reset)
		_followed.pose_updated.disconnect(_move)
	_followed = null


## Find the followed point in the scene.
func _reset() -> void:
	_patch = null
	var scene := _followed.get_character_scene() if _followed != null else null
	if scene != null:
		_patch = _find(scene)
	update_configuration_warnings()
	notify_property_list_changed()


func _find(scene: Scene) -> SurfacePatch:
	if vertex >= 0:
		return SurfacePatch.at_vertex(scene, vertex) if vertex < scene.vertex_count else null
	for each: Dictionary in scene.handles if handle else []:
		if each["name"] == handle:
			return SurfacePatch.at_vertex(scene, SurfacePatch.nearest(scene, each["position"]))
	for each: Dictionary in scene.limbs if limb and not handle else []:
		if each["name"] == limb:
			return _in_limb(scene, each["points"])
	return null


func _in_limb(scene: Scene, points: PackedVector3Array) -> SurfacePatch:
	var length := 0.0
	for i in points.size() - 1:
		length += points[i].distance_to(points[i + 1])
	var left := limb_position * length
	for i in points.size() - 1:
		var bone := points[i].distance_to(points[i + 1])
		if left <= bone or i == points.size() - 2:
			var share := clampf(left / bone, 0.0, 1.0) if bone > 0.0 else 0.0
			return SurfacePatch.inside(scene, points[i].lerp(points[i + 1], share), points[i + 1] - points[i])
		left -= bone
	return null


func _move() -> void:
	if _patch == null:
		return
	var space := _followed.global_transform
	var pose := _followed.get_patch_transform(_patch, space)
	if not follow_rotation:
		pose.basis = Basis(space.basis.get_rotation_quaternion())
	global_transform = pose * offset
