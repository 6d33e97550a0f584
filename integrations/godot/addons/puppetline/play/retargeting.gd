extends RefCounted
## Turns the bones of any skeleton as the character's own joints turn, whatever the rest poses of both.
##
## A joint's rotation from the T-pose, T = M F (F from the T-pose to rest, M since rest), gives the mapped bone the
## rotation T C G. G is the bone's own rotation at rest, and C turns it from there to the T-pose. Other joints, such as
## those of tails, have no T-pose: the bone turns as the joint does since rest.

const BonePose := preload("bone_pose.gd")
const Scene := preload("../wire/scene.gd")

## The joint to which a bone points in a T-pose.
const _NEXT: Dictionary = {
	"UpperArm": "LowerArm", "LowerArm": "Hand", "UpperLeg": "LowerLeg", "LowerLeg": "Foot", "Foot": "Toes"
}
const _MIDDLE: Array = ["hips", "spine", "chest", "upperChest", "neck", "head"]
## Minimum horizontal length of a foot's unit direction for the foot to have a heading.
const _MIN_HEADING_SHARE := 0.1

var _bones: Array[Dictionary]
var _rest: BonePose
var _joint_of: Dictionary = {}  # bone: row of its joint
var _order: Array[int] = []  # the mapped bones, parents first
var _corrections: Dictionary = {}  # bone: its rotation at rest, after that from rest to the T-pose
var _to_file: Quaternion  # from the character's axes (left x, up y, front z) to the file's
var _to_skeleton: Quaternion  # from the character's axes to the skeleton's
var _moved := -1  # the bone that moves with the character, and the size of the skeleton beside it
var _size := 1.0


## [param mapped] has the bone of each joint, by the joint's name.
func _init(scene: Scene, skeleton: Skeleton3D, mapped: Dictionary) -> void:
	_bones = scene.bones
	_rest = BonePose.rest(_bones)
	_to_file = Basis(scene.up.cross(scene.front), scene.up, scene.front).get_rotation_quaternion()
	_to_skeleton = _axes(skeleton, mapped)
	for row in _bones.size():
		if _bones[row]["name"] in mapped:
			_joint_of[mapped[_bones[row]["name"]]] = row
	_add_in_order(skeleton)
	var turns := {-1: Quaternion.IDENTITY}  # bone: from the T-pose to its rest, in the character's axes
	for bone in _order:
		turns[bone] = _to_rest(skeleton, bone, mapped, turns[_mapped_above(skeleton, bone)])
		var own := skeleton.get_bone_global_rest(bone).basis.get_rotation_quaternion()
		_corrections[bone] = turns[bone].inverse() * _to_skeleton.inverse() * own
	_moved = mapped.get("hips", _order[0] if not _order.is_empty() else -1)
	_size = _height(skeleton) if _moved >= 0 else 1.0


## Pose the skeleton. [param shift] is added to the position of its uppermost mapped bone, in the file's coordinates.
func apply(skeleton: Skeleton3D, pose: BonePose, shift: Vector3) -> void:
	for bone in _order:
		var row: int = _joint_of[bone]
		var turned: Quaternion = pose.rotations[row] * _rest.rotations[row].inverse()
		turned = _to_file.inverse() * turned * _to_file
		if _bones[row]["from_t_pose"] != null:
			turned *= _to_file.inverse() * (_bones[row]["from_t_pose"] as Quaternion) * _to_file
		var to := _to_skeleton * turned * (_corrections[bone] as Quaternion)
		var above := Transform3D.IDENTITY
		if skeleton.get_bone_parent(bone) >= 0:
			above = skeleton.get_bone_global_pose(skeleton.get_bone_parent(bone))
		skeleton.set_bone_pose_rotation(bone, above.basis.get_rotation_quaternion().inverse() * to)
		if bone == _moved:
			var moved := pose.positions[row] + shift - _rest.positions[row]
			var place := skeleton.get_bone_global_rest(bone).origin
			place += _to_skeleton * (_to_file.inverse() * moved) * _size
			skeleton.set_bone_pose_position(bone, above.affine_inverse() * place)


func _add_in_order(skeleton: Skeleton3D) -> void:
	var waiting: Array[int] = []
	waiting.assign(skeleton.get_parentless_bones())
	while not waiting.is_empty():
		var bone: int = waiting.pop_front()
		if bone in _joint_of:
			_order.append(bone)
		waiting.append_array(skeleton.get_bone_children(bone))


## Return the nearest mapped bone above another; −1 if there is none.
func _mapped_above(skeleton: Skeleton3D, bone: int) -> int:
	var above := skeleton.get_bone_parent(bone)
	while above >= 0 and above not in _joint_of:
		above = skeleton.get_bone_parent(above)
	return above


## Return the rotation of a bone from the T-pose to its rest, the least one relative to its parent's.
func _to_rest(skeleton: Skeleton3D, bone: int, mapped: Dictionary, parent: Quaternion) -> Quaternion:
	var joint := _bones[_joint_of[bone]]
	if joint["from_t_pose"] == null:
		return Quaternion.IDENTITY
	var name: String = joint["name"]
	var side := "left" if name.begins_with("left") else "right"
	var part := name.trim_prefix(side)
	var next: Variant = _next_in_middle(name, mapped) if name in _MIDDLE else side + str(_NEXT.get(part, ""))
	if next not in mapped:
		return Quaternion.IDENTITY if part == "Foot" else parent
	var here := skeleton.get_bone_global_rest(bone).origin
	var aim := _to_skeleton.inverse() * (skeleton.get_bone_global_rest(mapped[next]).origin - here).normalized()
	if part == "Foot":
		var flat := Vector2(aim.x, aim.z)
		var has_heading := flat.length() > _MIN_HEADING_SHARE
		return Quaternion(Vector3.UP, atan2(aim.x, aim.z)) if has_heading else Quaternion.IDENTITY
	if name in _MIDDLE and (joint["from_t_pose"] as Quaternion).is_equal_approx(Quaternion.IDENTITY):
		return parent  # the character's own rest counts as upright, and so does this one's
	if aim.is_zero_approx():
		return parent
	var straight := Vector3.DOWN if part.ends_with("Leg") else Vector3.RIGHT if side == "left" else Vector3.LEFT
	return _least(parent * (Vector3.UP if name in _MIDDLE else straight), aim) * parent


func _next_in_middle(name: String, mapped: Dictionary) -> Variant:
	for next: String in _MIDDLE.slice(_MIDDLE.find(name) + 1):
		if next in mapped:
			return next
	return null


static func _least(from: Vector3, to: Vector3) -> Quaternion:
	return Quaternion(Vector3.BACK, PI) if from.dot(to) < -0.999999 else Quaternion(from, to)


## Return the rotation from the character's axes to the skeleton's, by its legs; the usual axes if it has none.
static func _axes(skeleton: Skeleton3D, mapped: Dictionary) -> Quaternion:
	if not mapped.has_all(["leftUpperLeg", "rightUpperLeg", "leftFoot"]):
		return Quaternion.IDENTITY
	var hip := skeleton.get_bone_global_rest(mapped["leftUpperLeg"]).origin
	var left := _nearest_axis(hip - skeleton.get_bone_global_rest(mapped["rightUpperLeg"]).origin)
	var up := _nearest_axis(hip - skeleton.get_bone_global_rest(mapped["leftFoot"]).origin)
	if absf(left.dot(up)) > 0.5:
		return Quaternion.IDENTITY
	return Basis(left, up, left.cross(up)).get_rotation_quaternion()


static func _nearest_axis(direction: Vector3) -> Vector3:
	var axis := Vector3.ZERO
	axis[direction.abs().max_axis_index()] = signf(direction[direction.abs().max_axis_index()])
	return axis


## Return the height of the moved bone above the lowest mapped one, relative to that of the character's joints.
func _height(skeleton: Skeleton3D) -> float:
	var ours := 0.0
	var theirs := 0.0
	for bone in _order:
		var place := skeleton.get_bone_global_rest(bone).origin
		var own := _rest.positions[_joint_of[bone]]
		var above := _to_skeleton.inverse() * (skeleton.get_bone_global_rest(_moved).origin - place)
		theirs = maxf(theirs, above.y)
		ours = maxf(ours, (_to_file.inverse() * (_rest.positions[_joint_of[_moved]] - own)).y)
	return theirs / ours if theirs > 1e-6 and ours > 1e-6 else 1.0
