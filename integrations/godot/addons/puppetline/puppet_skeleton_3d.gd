@tool
class_name PuppetSkeleton3D
extends SkeletonModifier3D
## Turns the bones of a [Skeleton3D] as a performer of `puppetline serve` moves.
##
## Add the node below the [Skeleton3D] of any rigged character, which keeps its mesh and materials. The names of
## [SkeletonProfileHumanoid], VRM, Mixamo, Unreal and Rigify are recognised; [member bone_map] adds others. [member
## SkeletonModifier3D.influence] mixes the performer with other animations.

const Stream := preload("wire/stream.gd")
const ServiceLink := preload("wire/service_link.gd")
const Message := preload("wire/message.gd")
const Scene := preload("wire/scene.gd")
const SharedScene := preload("play/shared_scene.gd")
const ReceivedFrames := preload("play/received_frames.gd")
const BoneNames := preload("play/bone_names.gd")
const BonePose := preload("play/bone_pose.gd")
const Retargeting := preload("play/retargeting.gd")

@export_group("Service")
## Host name or address of the service. If empty, the first service found on the network that has the [member
## character].
@export var host := "127.0.0.1":
	set(value):
		_link_stale = _link_stale or value != host
		host = value
## Port of the stream.
@export_range(1, 65534) var port := 7400:
	set(value):
		_link_stale = _link_stale or value != port
		port = value
## The service's token, if it requires one. It is saved with the scene in plain text, and not sent to services found on
## the network.
@export var token := "":
	set(value):
		_link_stale = _link_stale or value != token
		token = value

@export_group("Character")
## Name of the service's character whose performer is followed. If empty, the first one.
@export var character := "":
	set(value):
		_link_stale = _link_stale or value != character
		character = value
## Follow only the performer with this user number; −1 for any.
@export var user_slot := -1
## Bones by joints of the service's character, both by name, for bones whose names are not recognised: `{"tail_1":
## "Tail"}`. An empty bone leaves a joint out.
@export var bone_map: Dictionary = {}:
	set(value):
		bone_map = value
		_is_stale = true
## Whether the skeleton walks with the performer, or stays in place.
@export var follow_root := true

@export_group("Playing")
## Delay in seconds, so that each image lies between two frames.
@export_range(0.0, 1.0, 0.005, "suffix:s") var interpolation_delay := 0.05:
	set(value):
		interpolation_delay = value
		_frames.delay = value

var _link: ServiceLink
var _shared: SharedScene
var _frames := ReceivedFrames.new()
var _retargeting: Retargeting
var _name := ""  # name of the followed character
var _link_stale := false
var _is_stale := false  # whether the bones must be found again
var _problem := ""
var _mapped: Dictionary = {}


func _init() -> void:
	_frames.delay = interpolation_delay


func _process(_delta: float) -> void:
	if _link_stale:
		_leave()
	if _link == null:
		_link = ServiceLink.new(name, host, port, token if host else "", character)
		_link.characters_changed.connect(_on_characters)
		_link.state_changed.connect(func(_before: Stream.State) -> void: update_configuration_warnings())
	if not _link.join():
		return
	if character and _name.is_empty():
		_follow(character)
	_link.stream.poll()
	_link.notice_state()
	_link_stale = _link_stale or _link.is_lost()
	if _shared != null:
		_shared.poll()
	if _is_stale and get_skeleton() != null and _scene() != null:
		_find_bones()


func _exit_tree() -> void:
	_leave()


func _process_modification() -> void:
	if _retargeting == null or not _frames.advance():
		return
	var shown := _frames.playback
	if user_slot >= 0 and shown.earlier.user != user_slot:
		return
	var pose := BonePose.between(_scene().bones, shown.earlier, shown.later, shown.share)
	var root := shown.earlier.root.lerp(shown.later.root, shown.share)
	_retargeting.apply(get_skeleton(), pose, Vector3.ZERO if follow_root else -root)


func _get_configuration_warnings() -> PackedStringArray:
	var warnings := PackedStringArray()
	var skeleton := get_skeleton()
	if skeleton == null:
		warnings.append("No skeleton to move. Put the node below a Skeleton3D.")
	for joint: Variant in bone_map if skeleton != null else {}:
		if bone_map[joint] and skeleton.find_bone(str(bone_map[joint])) < 0:
			warnings.append("bone_map: the skeleton has no bone '%s'." % bone_map[joint])
		if _scene() != null and str(joint) not in _joint_names():
			var names := ", ".join(_joint_names())
			warnings.append("bone_map: %s has no joint '%s'. Its joints are: %s." % [_name, joint, names])
	if _link != null and _link.state == Stream.State.REFUSED:
		warnings.append("The service refuses the connection: %s" % _link.stream.reason)
	if _link != null and character and not _link.characters.is_empty() and character not in _link.characters:
		var names := ", ".join(_link.characters)
		warnings.append("The service has no character '%s'. Its characters are: %s." % [character, names])
	if _problem:
		warnings.append(_problem)
	return warnings


## Return the name of the bone that follows each joint, by the joint's name. It is empty before the service's character
## has arrived.
func get_followed_bones() -> Dictionary:
	var bones := {}
	for joint: String in _mapped:
		bones[joint] = get_skeleton().get_bone_name(_mapped[joint])
	return bones


func _scene() -> Scene:
	return _shared.scene if _shared != null else null


func _joint_names() -> Array:
	return _scene().bones.map(func(bone: Dictionary) -> String: return bone["name"])


func _find_bones() -> void:
	_is_stale = false
	_retargeting = null
	_problem = ""
	_frames.clear()
	_mapped = BoneNames.bones_of(get_skeleton(), _joint_names(), bone_map)
	if _scene().bones.is_empty():
		_problem = "The service's character %s has no bones. Give it limbs in its puppet file." % _name
	elif _mapped.is_empty():
		_problem = "No bone of the skeleton has a known name. Set bone_map."
	else:
		_retargeting = Retargeting.new(_scene(), get_skeleton(), _mapped)
	if _problem:
		push_warning("Puppetline: %s" % _problem)
	update_configuration_warnings()


func _follow(which: String) -> void:
	_name = which
	_shared = SharedScene.shared(_link.stream, _name)
	_shared.changed.connect(_on_scene)
	_link.stream.follow(_name + "/bones", _on_frame)
	_is_stale = true


func _leave() -> void:
	_link_stale = false
	if _shared != null:
		_shared.changed.disconnect(_on_scene)
		_link.stream.unfollow(_name + "/bones", _on_frame)
	_shared = null
	_retargeting = null
	_mapped = {}
	_name = ""
	_frames.clear()
	var left := _link
	_link = null
	if left != null:
		left.close()


func _on_characters() -> void:
	update_configuration_warnings()
	if _name.is_empty() and not _link.characters.is_empty():
		_follow(_link.characters[0])


func _on_scene() -> void:
	_is_stale = true


func _on_frame(message: Message) -> void:
	if _scene() == null or _is_stale:
		return
	if message.revision != _scene().revision:
		_shared.ask()
	elif BonePose.is_valid(message.payload, _scene().bones):
		_frames.push(message, message.payload.size())
	else:
		_frames.damaged += 1
