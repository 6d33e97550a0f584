extends RefCounted
## A box around a character that is computed on the graphics card, at a cost that does not depend on its vertices.
##
## Of each field, a vertex lies between two isolines, so that this field puts it between where their transforms put a
## box of all such vertices; and the weights of the fields add up to 1.

const Scene := preload("../wire/scene.gd")

## Floats of a transform.
const _TRANSFORM := 12

var _boxes: Array[AABB] = []  # of each transform: around the vertices that it acts on, at rest
var _used := PackedInt32Array()  # transforms that act on any
var _weights := PackedFloat32Array()  # of these, those of their fields
var _isolines := 0


func _init(scene: Scene) -> void:
	_isolines = scene.isoline_count
	var reach := _reach(scene)
	for transform in reach.size():
		if reach[transform].size.x >= 0.0:
			_used.append(transform)
			_boxes.append(reach[transform])
			_weights.append(scene.weights[transform / _isolines])


## Return a box that no vertex leaves, for the controls of a frame: 3 × 4 floats a transform, row by row.
func around(controls: PackedByteArray) -> AABB:
	var numbers := controls.to_float32_array()
	var low := Vector3.ZERO
	var high := Vector3.ZERO
	var field := -1
	var weight := 0.0
	var box := AABB()
	for i in _used.size():
		var at := _used[i] * _TRANSFORM
		var moved := (
			Transform3D(
				Vector3(numbers[at], numbers[at + 4], numbers[at + 8]),
				Vector3(numbers[at + 1], numbers[at + 5], numbers[at + 9]),
				Vector3(numbers[at + 2], numbers[at + 6], numbers[at + 10]),
				Vector3(numbers[at + 3], numbers[at + 7], numbers[at + 11])
			)
			* _boxes[i]
		)
		if _used[i] / _isolines == field:
			box = box.merge(moved)
			continue
		low += weight * box.position
		high += weight * box.end
		field = _used[i] / _isolines
		weight = _weights[i]
		box = moved
	low += weight * box.position
	high += weight * box.end
	return AABB(low, high - low)


static func _reach(scene: Scene) -> Array[AABB]:
	var boxes: Array[AABB] = []
	for field in scene.field_count:
		boxes.append_array(_reach_of_field(scene, field))
	return boxes


## Return a box for each isoline of a field, around the vertices between its neighbours; of negative size if there are
## none.
static func _reach_of_field(scene: Scene, field: int) -> Array[AABB]:
	var gaps := scene.isoline_count - 1
	var low: Array[Vector3] = []
	var high: Array[Vector3] = []
	low.resize(gaps + 2)
	high.resize(gaps + 2)
	low.fill(Vector3.INF)
	high.fill(-Vector3.INF)
	# The gap between isolines k and k + 1 is number k + 1 here: there is one more, with nothing in it, at either end.
	var at := field
	for position in scene.positions:
		var gap := clampi(int(scene.ladder[at]), 0, gaps - 1) + 1
		low[gap] = low[gap].min(position)
		high[gap] = high[gap].max(position)
		at += scene.field_count
	var boxes: Array[AABB] = []
	for isoline in scene.isoline_count:
		var lowest := low[isoline].min(low[isoline + 1])
		var highest := high[isoline].max(high[isoline + 1])
		boxes.append(AABB(lowest, highest - lowest) if lowest.x <= highest.x else AABB(Vector3.ZERO, -Vector3.ONE))
	return boxes
