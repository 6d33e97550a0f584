extends RefCounted
## The joints of a character (docs/protocol.md, "Bones"), and their rotations in a frame.

const Message := preload("message.gd")
const Skeleton := preload("skeleton.gd")

## Maximum number of joints that are read.
const MAX_JOINTS := 4096

## Names of the joints, parents first.
var names := PackedStringArray()
## Index of the parent of each joint, −1 for none.
var parents := PackedInt32Array()
## Rotations of the joints at rest, in file coordinates.
var rest: Array[Quaternion] = []
## Positions of the joints at rest, in file coordinates.
var places := PackedVector3Array()
## Rotations of the joints from the T-pose to rest, in file coordinates.
var from_t_pose: Array[Quaternion] = []
## Whether each joint has a T-pose: those of a VRM humanoid.
var is_humanoid: Array[bool] = []
## Whether each joint moves relative to its parent.
var travels: Array[bool] = []


## Read the joints of the description of a scene; null if it has none, or if they are damaged.
static func parse(description: Dictionary) -> Skeleton:
	var table: Variant = description.get("bones")
	if not table is Array or table.is_empty() or table.size() > MAX_JOINTS:
		return null
	var skeleton := Skeleton.new()
	for row: Variant in table:
		if not row is Dictionary or not skeleton._add(row):
			push_warning("Puppetline: received a damaged table of bones. Update the service or the addon.")
			return null
	return skeleton


## Return whether a payload is a pose of these joints: it has their size, and all of its numbers are finite.
func is_pose(payload: PackedByteArray) -> bool:
	if payload.size() != 16 * names.size() + 12 * travels.count(true):
		return false
	for number in payload.to_float32_array():
		if not is_finite(number):
			return false
	return true


## Return the index of a joint, −1 if there is none of that name.
func find(name: String) -> int:
	return names.find(name)


## Return the rotations of all joints relative to their parents, between two frames.
func local_rotations(earlier: Message, later: Message, share: float) -> Array[Quaternion]:
	var found: Array[Quaternion] = []
	for joint in names.size():
		var turn := _rotation(earlier.payload, joint)
		found.append(turn.slerp(_rotation(later.payload, joint), share) if share > 0.0 else turn)
	return found


## Return the rotations of all joints since rest, in file coordinates, between two frames.
func motions(earlier: Message, later: Message, share: float) -> Array[Quaternion]:
	var found: Array[Quaternion] = []
	var turned: Array[Quaternion] = []
	var local := local_rotations(earlier, later, share)
	for joint in names.size():
		turned.append(local[joint] if parents[joint] < 0 else turned[parents[joint]] * local[joint])
		found.append(turned[joint] * rest[joint].inverse())
	return found


## Return the displacement of the first joint since rest, in file coordinates, between two frames.
func displacement(earlier: Message, later: Message, share: float) -> Vector3:
	if not travels[0]:
		return Vector3.ZERO
	var start := 16 * names.size()
	return _vector(earlier.payload, start).lerp(_vector(later.payload, start), share) - places[0]


func _add(row: Dictionary) -> bool:
	var parent: Variant = row.get("parent")
	var place: Variant = _numbers(row.get("position"), 3)
	var turn: Variant = _numbers(row.get("rotation"), 4)
	if not row.get("name") is String or not parent is float or place == null or turn == null:
		return false
	if parent < -1 or parent >= names.size():
		return false
	var own := Quaternion(turn[0], turn[1], turn[2], turn[3]).normalized()
	var above := int(parent)
	var at := Vector3(place[0], place[1], place[2])
	var posed: Variant = _numbers(row.get("from_t_pose"), 4)
	names.append(row["name"])
	parents.append(above)
	rest.append(own if above < 0 else rest[above] * own)
	places.append(at if above < 0 else places[above] + rest[above] * at)
	travels.append(row.get("travels") == true)
	is_humanoid.append(posed != null)
	from_t_pose.append(
		Quaternion.IDENTITY if posed == null else Quaternion(posed[0], posed[1], posed[2], posed[3]).normalized()
	)
	return true


static func _numbers(value: Variant, count: int) -> Variant:
	if not value is Array or value.size() != count:
		return null
	for each: Variant in value:
		if not each is float or not is_finite(each):
			return null
	return null if count == 4 and Vector4(value[0], value[1], value[2], value[3]).length_squared() < 1e-12 else value


## Return a rotation of a payload; none for a quaternion of length 0.
static func _rotation(payload: PackedByteArray, joint: int) -> Quaternion:
	var numbers := Vector4.ZERO
	for i in 4:
		numbers[i] = payload.decode_float(16 * joint + 4 * i)
	if numbers.length_squared() < 1e-12:
		return Quaternion.IDENTITY
	return Quaternion(numbers.x, numbers.y, numbers.z, numbers.w).normalized()


static func _vector(payload: PackedByteArray, start: int) -> Vector3:
	var found := Vector3.ZERO
	for i in 3:
		found[i] = payload.decode_float(start + 4 * i)
	return found
