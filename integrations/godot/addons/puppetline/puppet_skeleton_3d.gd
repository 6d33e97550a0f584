@tool
@icon("icons/puppet_skeleton_3d.svg")
class_name PuppetSkeleton3D
extends SkeletonModifier3D
## Drives the [Skeleton3D] above it by the joints of a character of a Puppetline service.
##
## A game's own rigged character follows the performer with its own mesh and materials. Bones are recognised by their
## names; [member bone_map] adds others or replaces them. [member SkeletonModifier3D.influence] blends the pose with the
## animations that play below. Morph targets of the meshes below the skeleton are set by their names.

## Emitted when the joints of the character are known.
signal joints_loaded

const Stream := preload("wire/stream.gd")
const Message := preload("wire/message.gd")
const Scene := preload("wire/scene.gd")
const Joints := preload("wire/skeleton.gd")
const JitterBuffer := preload("play/jitter_buffer.gd")
const SkeletonPose := preload("play/skeleton_pose.gd")
const OwnMesh := preload("play/own_mesh.gd")
const OwnTargets := preload("play/own_targets.gd")
const BoneNames := preload("play/bone_names.gd")

## Address of the service.
@export var host := "127.0.0.1":
	set(value):
		host = value
		_reconnect()
## Port of the stream.
@export_range(1, 65534) var port := 7400:
	set(value):
		port = value
		_reconnect()
## Token of the service, if it requires one.
@export var token := "":
	set(value):
		token = value
		_reconnect()
## Name of the character; empty for the first one.
@export var character := "":
	set(value):
		character = value
		_reconnect()
## Name of the bone for the name of a joint, besides the bones that are recognised. An empty name leaves a joint out.
@export var bone_map: Dictionary = {}:
	set(value):
		bone_map = value
		_prepare()
## Whether the hips travel with the character, in proportion to the length of the legs.
@export var moves_hips := true
## Time by which the pose lags behind the received frames, in seconds; it hides irregular arrival.
@export_range(0.0, 1.0, 0.01) var delay := 0.05:
	set(value):
		delay = value
		_frames.delay = value
## Whether the skeleton moves in the editor too.
@export var preview_in_editor := false:
	set(value):
		preview_in_editor = value
		_reconnect()

var _stream: Stream
var _followed := ""  # the character whose topics are followed
var _scene: Scene
var _joints: Joints
var _pose: SkeletonPose
var _own_targets: OwnTargets
var _frames := JitterBuffer.new()
var _damaged := 0


func _enter_tree() -> void:
	_reconnect()


func _exit_tree() -> void:
	_disconnect()


func _process(_delta: float) -> void:
	if _stream != null:
		_stream.poll()


func _get_configuration_warnings() -> PackedStringArray:
	var warnings := PackedStringArray()
	if get_skeleton() == null:
		warnings.append("No skeleton to drive. Put this node below a Skeleton3D.")
	elif _joints != null and _pose != null and _pose.bones.is_empty():
		warnings.append(
			"No bone of the skeleton has a known name. Set bone_map: %s." % ", ".join(_joints.names.slice(0, 5))
		)
	for joint: String in bone_map:
		if _joints != null and _joints.find(joint) < 0:
			warnings.append("The character has no joint '%s'." % joint)
		if get_skeleton() != null and bone_map[joint] and get_skeleton().find_bone(bone_map[joint]) < 0:
			warnings.append("The skeleton has no bone '%s'." % bone_map[joint])
	return warnings


## Return the names of the joints of the character; empty until they are known.
func joint_names() -> PackedStringArray:
	return _joints.names if _joints != null else PackedStringArray()


## Return the name of the driven bone for the name of each joint.
func driven_bones() -> Dictionary:
	var found: Dictionary = {}
	for joint: int in _pose.bones if _pose != null else {}:
		found[_joints.names[joint]] = get_skeleton().get_bone_name(_pose.bones[joint])
	return found


## Return the number of frames that were lost, and of those with a wrong size.
func statistics() -> Dictionary:
	return {"character": _followed, "lost": _frames.lost, "damaged": _damaged}


func _process_modification() -> void:
	if _pose == null or not _frames.advance(Time.get_ticks_usec() * 1e-6):
		return
	var earlier := _frames.earlier
	var later := _frames.later if JitterBuffer.continues(_frames.earlier, _frames.later) else _frames.earlier
	var share := _frames.share if later != earlier else 0.0
	var moved := _joints.displacement(earlier, later, share)
	_pose.apply(get_skeleton(), _joints.motions(earlier, later, share), moved, moves_hips)
	_own_targets.show_frames(earlier, later, share, influence)


func _reconnect() -> void:
	_disconnect()
	if not is_inside_tree() or (Engine.is_editor_hint() and not preview_in_editor):
		return
	_stream = Stream.shared(host, port, token)
	if character:
		_follow(character)
	else:
		_stream.follow("service/characters", _take_characters)


func _disconnect() -> void:
	if _stream != null:
		_stream.unfollow("service/characters", _take_characters)
		_unfollow()
	_stream = null
	_followed = ""


func _follow(name_of_character: String) -> void:
	_followed = name_of_character
	_stream.follow(name_of_character + "/scene", _take_scene)
	_stream.follow(name_of_character + "/bones", _take_frame)


func _unfollow() -> void:
	if _followed:
		_stream.unfollow(_followed + "/scene", _take_scene)
		_stream.unfollow(_followed + "/bones", _take_frame)
	_joints = null
	_pose = null
	_leave_targets()
	_frames.clear()


func _leave_targets() -> void:
	if _own_targets != null:
		_own_targets.reset()
	_own_targets = null


func _take_characters(message: Message) -> void:
	var listed: Variant = message.json()
	if not listed is Array or listed.is_empty() or not listed[0] is Dictionary or not listed[0].get("name") is String:
		return
	if listed[0]["name"] != _followed:
		_unfollow()
		_follow(listed[0]["name"])


func _take_scene(message: Message) -> void:
	var scene := Scene.parse(message.payload)
	if scene == null:
		return
	_scene = scene
	_joints = Joints.parse(scene.description)
	_leave_targets()
	_frames.clear()
	if _joints == null:
		push_warning(
			"Puppetline: the character '%s' has no joints. Its puppet file needs a table [[limb]]." % _followed
		)
	_prepare()
	joints_loaded.emit()


func _take_frame(message: Message) -> void:
	if _joints == null:
		return
	if not _joints.is_pose(message.payload):
		_damaged += 1
		return
	_frames.push(message, Time.get_ticks_usec() * 1e-6)


func _prepare() -> void:
	_pose = null
	var skeleton := get_skeleton()
	if skeleton != null and _joints != null:
		var map := BoneNames.recognised(skeleton, _joints.names)
		map.merge(bone_map, true)
		if _own_targets == null:
			_own_targets = OwnTargets.new(_scene, OwnMesh.meshes_below(skeleton))
		_pose = SkeletonPose.new(_joints, _scene.up, _scene.front, skeleton, map)
	update_configuration_warnings()
