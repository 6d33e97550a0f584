extends RefCounted
## Poses the bones of any skeleton by the joints of a character.
##
## Rotations do not depend on rest poses: those of a humanoid count from the T-pose, which is found for the driven
## skeleton by the directions of its arms and legs. Other joints turn as they have turned since rest.

const Joints := preload("../wire/skeleton.gd")

const _DIRECTIONS: Dictionary = {
	"UpperArm": Vector3.RIGHT, "LowerArm": Vector3.RIGHT, "UpperLeg": Vector3.DOWN, "LowerLeg": Vector3.DOWN
}
## Next joint in each limb.
const _NEXT: Dictionary = {
	"UpperArm": "LowerArm", "LowerArm": "Hand", "UpperLeg": "LowerLeg", "LowerLeg": "Foot", "Foot": "Toes"
}
## Joint above, whose rotation from the T-pose a joint without a direction has.
const _ABOVE: Dictionary = {"LowerArm": "UpperArm", "Hand": "LowerArm", "LowerLeg": "UpperLeg", "Toes": "Foot"}
## Minimum horizontal length of a foot's unit direction for the foot to have a heading.
const _MIN_HEADING := 0.1

## Bone for each driven joint, by index.
var bones: Dictionary = {}

var _joints: Joints
var _from_character := Basis.IDENTITY  # from the service's file coordinates to left, up and front
var _to_skeleton := Basis.IDENTITY  # from left, up and front to the driven skeleton
var _to_rest: Dictionary = {}  # joint: rotation of the driven bone from the T-pose to rest, character axes
var _rest: Dictionary = {}  # bone: global rotation at rest
var _ratio := 1.0
var _hips := -1


## Prepare a skeleton.
## [param map] has the name of a bone for the name of each joint.
func _init(joints: Joints, up: Vector3, front: Vector3, skeleton: Skeleton3D, map: Dictionary) -> void:
	_joints = joints
	_from_character = Basis(up.cross(front), up, front).transposed()
	for joint: String in map:
		var bone := skeleton.find_bone(map[joint])
		if joints.find(joint) >= 0 and bone >= 0:
			bones[joints.find(joint)] = bone
			_rest[bone] = skeleton.get_bone_global_rest(bone).basis.get_rotation_quaternion()
	_to_skeleton = _axes(skeleton)
	for joint: int in bones:
		if joints.is_humanoid[joint]:
			_to_rest[joint] = _from_t_pose(skeleton, joints.names[joint])
	_hips = joints.find("hips")
	_ratio = _leg_length(skeleton) / maxf(_own_leg_length(), 1e-9) if _own_leg_length() > 0.0 else 1.0


## Write the rotations of the bones, and the position of the hips if they travel.
func apply(skeleton: Skeleton3D, motions: Array[Quaternion], displacement: Vector3, moves_hips: bool) -> void:
	var ordered := bones.keys()
	ordered.sort_custom(func(a: int, b: int) -> bool: return bones[a] < bones[b])
	for joint: int in ordered:
		var bone: int = bones[joint]
		var turn := _in_character_axes(motions[joint])
		if joint in _to_rest:
			turn = turn * _in_character_axes(_joints.from_t_pose[joint]) * (_to_rest[joint] as Quaternion).inverse()
		var wanted := _in_skeleton_axes(turn) * (_rest[bone] as Quaternion)
		var parent := skeleton.get_bone_parent(bone)
		var above := Transform3D.IDENTITY if parent < 0 else skeleton.get_bone_global_pose(parent)
		var local := above.basis.get_rotation_quaternion().inverse() * wanted
		skeleton.set_bone_pose_rotation(bone, local.normalized())
		if moves_hips and joint == _hips:
			var moved := _to_skeleton * (_from_character * displacement) * _ratio
			var place := skeleton.get_bone_global_rest(bone).origin + moved
			skeleton.set_bone_pose_position(bone, above.affine_inverse() * place)


func _in_character_axes(turn: Quaternion) -> Quaternion:
	return (_from_character * Basis(turn) * _from_character.transposed()).get_rotation_quaternion()


func _in_skeleton_axes(turn: Quaternion) -> Quaternion:
	return (_to_skeleton * Basis(turn) * _to_skeleton.transposed()).get_rotation_quaternion()


## Return the place of a joint's bone at rest; null if it has none.
func _place(skeleton: Skeleton3D, joint: String) -> Variant:
	var bone: int = bones.get(_joints.find(joint), -1)
	return null if bone < 0 else skeleton.get_bone_global_rest(bone).origin


## Return the axes of the driven skeleton that are nearest to its left, up and front: from its legs or arms, and from
## its hips to its head.
func _axes(skeleton: Skeleton3D) -> Basis:
	var across := Vector3.ZERO
	for pair: String in ["UpperLeg", "UpperArm"]:
		var left: Variant = _place(skeleton, "left" + pair)
		var right: Variant = _place(skeleton, "right" + pair)
		if across == Vector3.ZERO and left != null and right != null:
			across = left - right
	var low: Variant = _place(skeleton, "hips")
	for top: String in ["head", "neck", "chest", "spine"]:
		var high: Variant = _place(skeleton, top)
		if low != null and high != null and across != Vector3.ZERO:
			var up := _nearest_axis(high - low)
			var left := _nearest_axis(across - across.project(up))
			return Basis(left, up, left.cross(up))
	return Basis.IDENTITY


func _nearest_axis(direction: Vector3) -> Vector3:
	var axis := direction.abs().max_axis_index()
	var found := Vector3.ZERO
	found[axis] = signf(direction[axis])
	return found


## Return the rotation of a bone of the driven skeleton from the T-pose to rest, in character axes: the least one
## relative to that of the bone above.
func _from_t_pose(skeleton: Skeleton3D, joint: String) -> Quaternion:
	var side := "left" if joint.begins_with("left") else "right"
	var part := joint.trim_prefix(side)
	if part == joint:
		return Quaternion.IDENTITY
	var above := Quaternion.IDENTITY
	if part in _ABOVE and _place(skeleton, side + _ABOVE[part]) != null:
		above = _from_t_pose(skeleton, side + _ABOVE[part])
	var start: Variant = _place(skeleton, joint)
	var end: Variant = _place(skeleton, side + _NEXT.get(part, ""))
	if start == null or end == null or (end - start).is_zero_approx():
		return above
	var aim: Vector3 = (_to_skeleton.transposed() * (end - start)).normalized()
	if part == "Foot":
		var flat := Vector2(aim.x, aim.z)
		return Quaternion(Vector3.UP, atan2(aim.x, aim.z)) if flat.length() > _MIN_HEADING else Quaternion.IDENTITY
	if part not in _DIRECTIONS:
		return above
	var straight: Vector3 = _DIRECTIONS[part]
	if part.ends_with("Arm") and side == "right":
		straight = -straight
	return Quaternion(above * straight, aim) * above


## Return the length of the driven skeleton's left leg; 0 if it is unknown.
func _leg_length(skeleton: Skeleton3D) -> float:
	var places := ["leftUpperLeg", "leftLowerLeg", "leftFoot"].map(
		func(joint: String) -> Variant: return _place(skeleton, joint)
	)
	if null in places:
		return 0.0
	return places[0].distance_to(places[1]) + places[1].distance_to(places[2])


func _own_leg_length() -> float:
	var rows := ["leftUpperLeg", "leftLowerLeg", "leftFoot"].map(_joints.find)
	if -1 in rows:
		return 0.0
	var places := _joints.places
	return places[rows[0]].distance_to(places[rows[1]]) + places[rows[1]].distance_to(places[rows[2]])
