extends RefCounted
## All of a character that does not change (docs/protocol.md, "Scene"): what a client needs to draw it and to follow its
## controls.

const Scene := preload("scene.gd")

const MOST_VERTICES := 1 << 24
## More than any number of a description can sensibly be, and well within 32 bits.
const LARGEST_NUMBER := 1e30
## Bytes; a part takes some 300.
const LARGEST_DESCRIPTION := 1 << 22

## The description as it came. What is in the members below has been checked; of the rest nothing has.
var description: Dictionary = {}
var revision := 0
var vertex_count := 0
var triangle_count := 0
var field_count := 0
var isoline_count := 0
## One a field; they add up to 1.
var weights := PackedFloat32Array()
## Three vertices a triangle, counter-clockwise seen from outside: Godot wants them the other way round.
var triangles := PackedInt32Array()
## The rest pose.
var positions := PackedVector3Array()
var normals := PackedVector3Array()
## Ladder coordinates, [member field_count] a vertex. They are not checked: who looks up isolines by them keeps within
## those that there are.
var ladder := PackedFloat32Array()
## Two a ladder coordinate.
var slopes := PackedFloat32Array()
## Empty if the character has none.
var uv := PackedVector2Array()
## Linear RGB, three a vertex; empty if there are none.
var colors := PackedFloat32Array()
## Dictionaries of `name` (String), `vertices` and `triangles` ([first, count]) and `material`, which has all that the
## protocol names: `name`, `base_color` (4 numbers), `metallic`, `roughness`, `emissive` (3 numbers), `alpha_mode`,
## `double_sided`.
var parts: Array[Dictionary] = []
## Of the rest pose.
var bounds := AABB()
var diagonal := 0.0
## Dictionaries of `name`, `position` (Vector3) and `joints` (names).
var handles: Array = []
## Names.
var joints: Array = []
## Names of the morph targets, or null.
var morphs: Variant = null

var _arrays := 0
var _fault := ""


## Read the payload of a scene message; null, and a warning that says why, if it is damaged.
static func parse(payload: PackedByteArray) -> Scene:
	var scene := Scene.new()
	if scene._read(payload):
		return scene
	var fault := scene._fault if scene._fault else "something in it is not as it should be"
	push_warning("Puppetline: a scene came that cannot be used: %s. Is this the service's port?" % fault)
	return null


## Each step says at its end that it went well, so that one which does not get there has not.
func _read(payload: PackedByteArray) -> bool:
	return (
		_read_description(payload)
		and _read_counts()
		and _read_arrays(payload)
		and _check_triangles()
		and _read_bounds()
		and _read_parts()
		and _read_names()
	)


## Keep the first fault; what is read after it is not used.
func _fail(fault: String) -> bool:
	if _fault.is_empty():
		_fault = fault
	return false


func _read_description(payload: PackedByteArray) -> bool:
	var length := payload.decode_u32(0) if payload.size() >= 4 else 0
	_arrays = 4 + length
	if length == 0 or length > LARGEST_DESCRIPTION or _arrays > payload.size():
		return _fail("its description has %d bytes, and all of it %d" % [length, payload.size()])
	var reader := JSON.new()
	if reader.parse(payload.slice(4, _arrays).get_string_from_utf8()) != OK or not reader.data is Dictionary:
		return _fail("its description is no JSON object")
	description = reader.data
	return true


func _read_counts() -> bool:
	revision = _whole(description, "revision", 0, 0xFFFFFFFF)
	vertex_count = _whole(description, "vertices", 1, MOST_VERTICES)
	triangle_count = _whole(description, "triangles", 1, 2 * MOST_VERTICES)
	field_count = _whole(description, "fields", 1, 1024)
	isoline_count = _whole(description, "isolines", 2, 1024)
	diagonal = _number(description.get("diagonal"))
	if diagonal <= 0.0:
		_fail("its diagonal is %s" % str(description.get("diagonal")).left(80))
	var found := _numbers(description.get("weights"), field_count)
	if found.is_empty() or found.min() < 0.0 or found.max() > 1.0 + 1e-6:
		_fail("its %d fields have no weights from 0 to 1" % field_count)
	weights = PackedFloat32Array(found)
	return _fault.is_empty()


func _read_arrays(payload: PackedByteArray) -> bool:
	triangles = _bytes(payload, "triangles", "u32", [triangle_count, 3]).to_int32_array()
	positions = _vectors(_bytes(payload, "positions", "f32", [vertex_count, 3]), TYPE_PACKED_VECTOR3_ARRAY, 12)
	normals = _vectors(_bytes(payload, "normals", "f32", [vertex_count, 3]), TYPE_PACKED_VECTOR3_ARRAY, 12)
	ladder = _bytes(payload, "ladder", "f32", [vertex_count, field_count]).to_float32_array()
	slopes = _bytes(payload, "slopes", "f32", [vertex_count, field_count, 2]).to_float32_array()
	if _directory().has("uv"):
		uv = _vectors(_bytes(payload, "uv", "f32", [vertex_count, 2]), TYPE_PACKED_VECTOR2_ARRAY, 8)
	if _directory().has("colors"):
		colors = _bytes(payload, "colors", "f32", [vertex_count, 3]).to_float32_array()
	var ladders := vertex_count * field_count
	var are_whole := positions.size() == vertex_count and normals.size() == vertex_count
	return _fault.is_empty() and are_whole and ladder.size() == ladders and slopes.size() == 2 * ladders


func _check_triangles() -> bool:
	var sorted := triangles.duplicate()  # the lowest and the highest without a loop in script
	sorted.sort()
	if sorted[0] < 0 or sorted[-1] >= vertex_count:
		return _fail("a triangle has a vertex that is not there")
	return true


func _read_bounds() -> bool:
	var corners: Variant = description.get("bounds")
	if not corners is Array or corners.size() != 2:
		return _fail("its bounds are no two corners")
	var low := _numbers(corners[0], 3)
	var high := _numbers(corners[1], 3)
	if low.is_empty() or high.is_empty():
		return _fail("its bounds are no two corners")
	var lowest := Vector3(low[0], low[1], low[2])
	bounds = AABB(lowest, Vector3(high[0], high[1], high[2]) - lowest).abs()
	return true


func _read_parts() -> bool:
	var vertices_left := vertex_count
	var triangles_left := triangle_count
	for found: Variant in _list(description, "parts"):
		if not found is Dictionary:
			return _fail("a part is no object")
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
			return _fail("its parts have more vertices or triangles than there are")
	return _fault.is_empty()


func _read_names() -> bool:
	joints = _list(description, "joints").map(func(name: Variant) -> String: return str(name))
	if description.get("morphs") != null:
		morphs = _list(description, "morphs").map(func(name: Variant) -> String: return str(name))
	for found: Variant in _list(description, "handles"):
		if not found is Dictionary or _numbers(found.get("position"), 3).is_empty():
			return _fail("a handle has no position")
		var place := _numbers(found.position, 3)
		handles.append(
			{
				"name": str(found.get("name", "")),
				"position": Vector3(place[0], place[1], place[2]),
				"joints": _list(found, "joints").map(func(name: Variant) -> String: return str(name)),
			}
		)
	return _fault.is_empty()


func _directory() -> Dictionary:
	var found: Variant = description.get("arrays")
	return found if found is Dictionary else {}


## Return the bytes of an array, or none if it is not there as it should be.
func _bytes(payload: PackedByteArray, name: String, type: String, shape: Array[int]) -> PackedByteArray:
	if not _fault.is_empty():
		return PackedByteArray()
	var entry: Variant = _directory().get(name)
	if not entry is Dictionary or str(entry.get("type")) != type or not _same(entry.get("shape"), shape):
		_fail("its array %s is not %s of the shape %s" % [name, type, shape])
		return PackedByteArray()
	var size: int = shape.reduce(func(product: int, count: int) -> int: return product * count, 4)
	var start := _arrays + _whole(entry, "offset", 0, payload.size())
	if start + size > payload.size():
		_fail("its array %s goes beyond its end" % name)
		return PackedByteArray()
	return payload.slice(start, start + size)


## Turn bytes into an array of vectors without a loop in script: as what [method @GlobalScope.var_to_bytes] would write.
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
		_fail("a part's %s are not among the %d" % [name, count])
		return [0, 0]
	return [int(found[0]), int(found[1])]


func _material(found: Variant) -> Dictionary:
	var material: Dictionary = found if found is Dictionary else {}
	return {
		"name": str(material.get("name", "")),
		"base_color": _or(_numbers(material.get("base_color"), 4), [1.0, 1.0, 1.0, 1.0]),
		"metallic": clampf(_number(material.get("metallic"), 1.0), 0.0, 1.0),
		"roughness": clampf(_number(material.get("roughness"), 1.0), 0.0, 1.0),
		"emissive": _or(_numbers(material.get("emissive"), 3), [0.0, 0.0, 0.0]),
		"alpha_mode": str(material.get("alpha_mode", "OPAQUE")),
		"double_sided": material.get("double_sided") is bool and material["double_sided"],
	}


func _or(found: Array[float], otherwise: Array[float]) -> Array[float]:
	return otherwise if found.is_empty() else found


func _whole(from: Dictionary, name: String, least: int, most: int) -> int:
	var number := _number(from.get(name), NAN)
	if not (number >= least and number <= most and number == floorf(number)):
		_fail("its %s is %s, and not a number from %d to %d" % [name, str(from.get(name)).left(80), least, most])
		return least
	return int(number)


func _list(from: Dictionary, name: String) -> Array:
	var found: Variant = from.get(name)
	if found is Array:
		return found
	_fail("its %s are no list" % name)
	return []


func _number(found: Variant, otherwise := 0.0) -> float:
	if (found is float or found is int) and absf(found) <= LARGEST_NUMBER:
		return found
	return otherwise


## Return so many numbers, or none.
func _numbers(found: Variant, count: int) -> Array[float]:
	var numbers: Array[float] = []
	if not found is Array or found.size() != count:
		return numbers
	for each: Variant in found:
		if is_nan(_number(each, NAN)):
			return []
		numbers.append(_number(each))
	return numbers


func _same(found: Variant, shape: Array[int]) -> bool:
	var numbers := _numbers(found, shape.size())
	for i in numbers.size():
		if numbers[i] != shape[i]:
			return false
	return not numbers.is_empty()
