extends RefCounted
## The constant data of a character (docs/protocol.md, "Scene"), which a client needs to draw it and to evaluate its
## controls.

const Scene := preload("scene.gd")

const MAX_VERTICES := 1 << 24
## Maximum magnitude of a number in the description: more than any meaningful value, and well within 32-bit floats.
const MAX_MAGNITUDE := 1e30
## Maximum size of the description, in bytes. A part takes about 300 bytes.
const MAX_DESCRIPTION_BYTES := 1 << 22

const _AXES: Dictionary = {"x": Vector3.RIGHT, "y": Vector3.UP, "z": Vector3.BACK}

## The payload of the message as received, for recordings.
var encoded := PackedByteArray()
## The description as received. Only the values in the members below have been checked.
var description: Dictionary = {}
var revision := 0
var vertex_count := 0
var triangle_count := 0
var field_count := 0
var isoline_count := 0
## One weight per field; their sum is 1.
var weights := PackedFloat32Array()
## Three vertices per triangle, counter-clockwise seen from outside. Godot requires the opposite order.
var triangles := PackedInt32Array()
## Positions of the rest pose.
var positions := PackedVector3Array()
var normals := PackedVector3Array()
## Isoline coordinates, [member field_count] per vertex. They are not checked: code that looks up isolines must clamp
## them.
var isoline_coordinates := PackedFloat32Array()
## Two slopes per isoline coordinate.
var slopes := PackedFloat32Array()
## Texture coordinates; empty if the character has none.
var uv := PackedVector2Array()
## Linear RGB, three numbers per vertex; empty if the character has no colours.
var colors := PackedFloat32Array()
## Dictionaries of `name` (String), `vertices` and `triangles` ([first, count]) and `material`, which has all values of
## the protocol: `name`, `base_color` (4 numbers), `metallic`, `roughness`, `emissive` (3 numbers), `alpha_mode`,
## `double_sided`.
var parts: Array[Dictionary] = []
## Bounding box of the rest pose.
var bounds := AABB()
var diagonal := 0.0
## Dictionaries of `name`, `position` (Vector3) and `joints` (names).
var handles: Array = []
## Dictionaries of `name` and `points` (PackedVector3Array, root to tip, in the rest pose).
var limbs: Array = []
## Axes that point up and to the front of the character.
var up := Vector3.UP
var front := Vector3.BACK
## Names of the joints.
var joints: Array = []
## Names of the morph targets, or null.
var morphs: Variant = null
## Names of the mesh's own targets whose weights the frames have.
var targets := PackedStringArray()
## Displacements of all vertices by each of these targets; empty if there are none.
var displacements := PackedVector3Array()
var displacement_count := 0

var _arrays_start := 0
var _error := ""


## Read the payload of a scene message. If it is damaged, return null and print a warning with the reason.
static func parse(payload: PackedByteArray) -> Scene:
	var scene := Scene.new()
	scene.encoded = payload
	if scene._read(payload):
		return scene
	var error := scene._error if scene._error else "it has an invalid value"
	push_warning("Puppetline: received a damaged scene: %s. Check the port." % error)
	return null


## Return the position of a vertex at rest, for weights of the mesh's own targets.
func rest_position(vertex: int, target_weights: PackedFloat32Array) -> Vector3:
	var position := positions[vertex]
	for target in mini(displacement_count, target_weights.size()):
		position += target_weights[target] * displacements[target * vertex_count + vertex]
	return position


## Each step returns true at its end. A script error within a step therefore counts as failure.
func _read(payload: PackedByteArray) -> bool:
	return (
		_read_description(payload)
		and _read_counts()
		and _read_arrays(payload)
		and _check_triangles()
		and _check_isoline_coordinates()
		and _read_bounds()
		and _read_parts()
		and _read_names()
	)


## Keep the first error; values that are read after it are not used.
func _fail(error: String) -> bool:
	if _error.is_empty():
		_error = error
	return false


func _read_description(payload: PackedByteArray) -> bool:
	var length := payload.decode_u32(0) if payload.size() >= 4 else 0
	_arrays_start = 4 + length
	if length == 0 or length > MAX_DESCRIPTION_BYTES or _arrays_start > payload.size():
		return _fail("its description has %d bytes, and the whole payload %d" % [length, payload.size()])
	var reader := JSON.new()
	if reader.parse(payload.slice(4, _arrays_start).get_string_from_utf8()) != OK or not reader.data is Dictionary:
		return _fail("its description is not a JSON object")
	description = reader.data
	return true


func _read_counts() -> bool:
	revision = _integer(description, "revision", 0, 0xFFFFFFFF)
	vertex_count = _integer(description, "vertices", 1, MAX_VERTICES)
	triangle_count = _integer(description, "triangles", 1, 2 * MAX_VERTICES)
	field_count = _integer(description, "fields", 1, 1024)
	isoline_count = _integer(description, "isolines", 2, 1024)
	if description.get("targets") != null:
		targets = PackedStringArray(_list(description, "targets").map(func(name: Variant) -> String: return str(name)))
	diagonal = _number(description.get("diagonal"))
	if diagonal <= 0.0:
		_fail("its diagonal is %s" % str(description.get("diagonal")).left(80))
	var found := _numbers(description.get("weights"), field_count)
	if found.is_empty() or found.min() < 0.0 or found.max() > 1.0 + 1e-6:
		_fail("its %d fields do not all have weights from 0 to 1" % field_count)
	weights = PackedFloat32Array(found)
	return _error.is_empty()


func _read_arrays(payload: PackedByteArray) -> bool:
	triangles = _bytes(payload, "triangles", "u32", [triangle_count, 3]).to_int32_array()
	positions = _vectors(_bytes(payload, "positions", "f32", [vertex_count, 3]), TYPE_PACKED_VECTOR3_ARRAY, 12)
	normals = _vectors(_bytes(payload, "normals", "f32", [vertex_count, 3]), TYPE_PACKED_VECTOR3_ARRAY, 12)
	isoline_coordinates = _bytes(payload, "ladder", "f32", [vertex_count, field_count]).to_float32_array()
	slopes = _bytes(payload, "slopes", "f32", [vertex_count, field_count, 2]).to_float32_array()
	if _array_entries().has("uv"):
		uv = _vectors(_bytes(payload, "uv", "f32", [vertex_count, 2]), TYPE_PACKED_VECTOR2_ARRAY, 8)
	if _array_entries().has("colors"):
		colors = _bytes(payload, "colors", "f32", [vertex_count, 3]).to_float32_array()
	if _array_entries().has("displacements"):
		var moved := _bytes(payload, "displacements", "f32", [targets.size(), vertex_count, 3])
		displacements = _vectors(moved, TYPE_PACKED_VECTOR3_ARRAY, 12)
		displacement_count = displacements.size() / vertex_count
	var count := vertex_count * field_count
	var are_complete := positions.size() == vertex_count and normals.size() == vertex_count
	return _error.is_empty() and are_complete and isoline_coordinates.size() == count and slopes.size() == 2 * count


func _check_triangles() -> bool:
	var sorted := triangles.duplicate()  # finds minimum and maximum without a loop in script
	sorted.sort()
	if sorted[0] < 0 or sorted[-1] >= vertex_count:
		return _fail("a triangle has a vertex that does not exist")
	return true


## Refuse what is not from 0 to the last isoline. As integers, the bits of positive floats have the order of the floats,
## and those of NaN come last.
func _check_isoline_coordinates() -> bool:
	var bits := isoline_coordinates.to_byte_array().to_int32_array()
	bits.sort()
	var most := PackedFloat32Array([isoline_count - 1.0]).to_byte_array().decode_s32(0)
	var first := bits.bsearch(-0x80000000, false)  # after those of -0
	if bits[-1] > most or (first < bits.size() and bits[first] < 0):
		return _fail("an isoline coordinate is beyond the isolines")
	return true


func _read_bounds() -> bool:
	var corners: Variant = description.get("bounds")
	if not corners is Array or corners.size() != 2:
		return _fail("its bounds are not two corners")
	var low := _numbers(corners[0], 3)
	var high := _numbers(corners[1], 3)
	if low.is_empty() or high.is_empty():
		return _fail("its bounds are not two corners")
	var lowest := Vector3(low[0], low[1], low[2])
	bounds = AABB(lowest, Vector3(high[0], high[1], high[2]) - lowest).abs()
	return true


func _read_parts() -> bool:
	var vertices_left := vertex_count
	var triangles_left := triangle_count
	for found: Variant in _list(description, "parts"):
		if not found is Dictionary:
			return _fail("a part is not an object")
		(
			parts
			. append(
				{
					"name": str(found.get("name", "")),
					"vertices": _range(found, "vertices", vertex_count),
					"triangles": _range(found, "triangles", triangle_count),
					"material": _material(found.get("material")),
				}
			)
		)
		vertices_left -= parts[-1]["vertices"][1]
		triangles_left -= parts[-1]["triangles"][1]
		if vertices_left < 0 or triangles_left < 0:
			return _fail("its parts have more vertices or triangles than the scene")
	return _error.is_empty()


func _read_names() -> bool:
	joints = _list(description, "joints").map(func(name: Variant) -> String: return str(name))
	if description.get("morphs") != null:
		morphs = _list(description, "morphs").map(func(name: Variant) -> String: return str(name))
	for found: Variant in _list(description, "handles"):
		if not found is Dictionary or _numbers(found.get("position"), 3).is_empty():
			return _fail("a handle has no position")
		var position := _numbers(found.position, 3)
		handles.append(
			{
				"name": str(found.get("name", "")),
				"position": Vector3(position[0], position[1], position[2]),
				"joints": _list(found, "joints").map(func(name: Variant) -> String: return str(name)),
			}
		)
	_read_limbs()
	up = _axis("up", up)
	front = _axis("front", front).rotated(up, deg_to_rad(_number(description.get("turn"))))
	return _error.is_empty()


## Read the limbs, which earlier versions of the service do not send.
func _read_limbs() -> void:
	for found: Variant in _list(description, "limbs") if "limbs" in description else []:
		var points := PackedVector3Array()
		for point: Variant in found["points"] if found is Dictionary and found.get("points") is Array else []:
			var numbers := _numbers(point, 3)
			if numbers.is_empty():
				break
			points.append(Vector3(numbers[0], numbers[1], numbers[2]))
		if points.size() < 2:
			_fail("a limb does not have two points")
			return
		limbs.append({"name": str(found.get("name", "")), "points": points})


## Return an axis such as "y" or "-z".
func _axis(name: String, otherwise: Vector3) -> Vector3:
	var text := str(description.get(name))
	var axis: Vector3 = _AXES.get(text.trim_prefix("-"), otherwise)
	return -axis if text.begins_with("-") else axis


func _array_entries() -> Dictionary:
	var found: Variant = description.get("arrays")
	return found if found is Dictionary else {}


## Return the bytes of an array; empty if the array is missing or has another type or shape.
func _bytes(payload: PackedByteArray, name: String, type: String, shape: Array[int]) -> PackedByteArray:
	if not _error.is_empty():
		return PackedByteArray()
	var entry: Variant = _array_entries().get(name)
	if not entry is Dictionary or str(entry.get("type")) != type or not _is_shape(entry.get("shape"), shape):
		_fail("its array %s does not have the type %s and the shape %s" % [name, type, shape])
		return PackedByteArray()
	var size: int = shape.reduce(func(product: int, count: int) -> int: return product * count, 4)
	var start := _arrays_start + _integer(entry, "offset", 0, payload.size())
	if start + size > payload.size():
		_fail("its array %s extends beyond the end of the payload" % name)
		return PackedByteArray()
	return payload.slice(start, start + size)


## Convert bytes to an array of vectors without a loop in script, in the format of [method @GlobalScope.var_to_bytes].
func _vectors(bytes: PackedByteArray, type: Variant.Type, size: int) -> Variant:
	var written := PackedByteArray()
	written.resize(8)
	written.encode_u32(0, type)
	written.encode_u32(4, bytes.size() / size)
	written.append_array(bytes)
	return bytes_to_var(written)


func _range(part: Dictionary, name: String, count: int) -> Array[int]:
	var found := _numbers(part.get(name), 2)
	if found.is_empty() or found[0] < 0 or found[1] < 0 or found[0] + found[1] > count:
		_fail("a part's %s are outside of the scene's %d" % [name, count])
		return [0, 0]
	return [int(found[0]), int(found[1])]


func _material(found: Variant) -> Dictionary:
	var material: Dictionary = found if found is Dictionary else {}
	return {
		"name": str(material.get("name", "")),
		"base_color": _numbers_or(_numbers(material.get("base_color"), 4), [1.0, 1.0, 1.0, 1.0]),
		"metallic": clampf(_number(material.get("metallic"), 1.0), 0.0, 1.0),
		"roughness": clampf(_number(material.get("roughness"), 1.0), 0.0, 1.0),
		"emissive": _numbers_or(_numbers(material.get("emissive"), 3), [0.0, 0.0, 0.0]),
		"alpha_mode": str(material.get("alpha_mode", "OPAQUE")),
		"double_sided": material.get("double_sided") is bool and material["double_sided"],
	}


func _numbers_or(found: Array[float], default: Array[float]) -> Array[float]:
	return default if found.is_empty() else found


func _integer(from: Dictionary, name: String, minimum: int, maximum: int) -> int:
	var number := _number(from.get(name), NAN)
	if not (number >= minimum and number <= maximum and number == floorf(number)):
		_fail(
			"its %s is %s instead of an integer from %d to %d" % [name, str(from.get(name)).left(80), minimum, maximum]
		)
		return minimum
	return int(number)


func _list(from: Dictionary, name: String) -> Array:
	var found: Variant = from.get(name)
	if found is Array:
		return found
	_fail("its %s is not a list" % name)
	return []


func _number(found: Variant, default := 0.0) -> float:
	if (found is float or found is int) and absf(found) <= MAX_MAGNITUDE:
		return found
	return default


## Return an array of exactly this many numbers; empty if it is anything else.
func _numbers(found: Variant, count: int) -> Array[float]:
	var numbers: Array[float] = []
	if not found is Array or found.size() != count:
		return numbers
	for each: Variant in found:
		if is_nan(_number(each, NAN)):
			return []
		numbers.append(_number(each))
	return numbers


func _is_shape(found: Variant, shape: Array[int]) -> bool:
	var numbers := _numbers(found, shape.size())
	for i in numbers.size():
		if numbers[i] != shape[i]:
			return false
	return not numbers.is_empty()
