extends RefCounted
## A pose of a character's own joints, from a frame of bones (docs/protocol.md, "Bones").

const BonePose := preload("bone_pose.gd")
const Message := preload("../wire/message.gd")

## Rotations and positions of the joints, in the coordinates of the character's file.
var rotations: Array[Quaternion] = []
var positions := PackedVector3Array()


## Return the size of a frame's payload in bytes.
static func payload_size(bones: Array[Dictionary]) -> int:
	return bones.reduce(func(size: int, bone: Dictionary) -> int: return size + (28 if bone["travels"] else 16), 0)


## Return whether a payload has finite positions and unit quaternions for these joints.
static func is_valid(payload: PackedByteArray, bones: Array[Dictionary]) -> bool:
	var numbers := payload.to_float32_array()
	if payload.size() != payload_size(bones):
		return false
	for number in numbers:
		if not is_finite(number):
			return false
	for row in bones.size():
		if absf(_turn(numbers, row).length() - 1.0) > 0.01:
			return false
	return true


## Return the pose at rest.
static func rest(bones: Array[Dictionary]) -> BonePose:
	var pose := BonePose.new()
	for bone in bones:
		pose._add(bone["parent"], bone["position"], bone["rotation"])
	return pose


## Return the pose between two valid frames, at a share of the way.
static func between(bones: Array[Dictionary], earlier: Message, later: Message, share: float) -> BonePose:
	var pose := BonePose.new()
	var before := earlier.payload.to_float32_array()
	var after := later.payload.to_float32_array()
	var at := 4 * bones.size()
	for row in bones.size():
		var position: Vector3 = bones[row]["position"]
		if bones[row]["travels"]:
			var from := Vector3(before[at], before[at + 1], before[at + 2])
			position = from.lerp(Vector3(after[at], after[at + 1], after[at + 2]), share)
			at += 3
		var turn := _turn(before, row).normalized().slerp(_turn(after, row).normalized(), share)
		pose._add(bones[row]["parent"], position, turn)
	return pose


static func _turn(numbers: PackedFloat32Array, row: int) -> Quaternion:
	return Quaternion(numbers[4 * row], numbers[4 * row + 1], numbers[4 * row + 2], numbers[4 * row + 3])


## Add a joint by its pose relative to its parent.
func _add(parent: int, position: Vector3, rotation: Quaternion) -> void:
	if parent < 0:
		rotations.append(rotation)
		positions.append(position)
	else:
		rotations.append(rotations[parent] * rotation)
		positions.append(positions[parent] + rotations[parent] * position)
