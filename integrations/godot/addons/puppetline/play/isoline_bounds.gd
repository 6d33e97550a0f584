extends RefCounted
## A box around a character that is computed on the graphics card, at a cost that does not depend on its vertices.
##
## Each field puts a vertex between where the transforms of two isolines put it, and the weights of the fields add up
## to 1. What holds for a vertex holds for a box of vertices, with all isolines that are around these; the smaller the
## boxes, the closer the whole.

const Scene := preload("../wire/scene.gd")

## Floats of a transform.
const _TRANSFORM := 12
## Times that the character at rest is cut into halves.
const _CUTS := 4

var _pieces: Array[_Piece] = []
var _weights := PackedFloat32Array()
var _isolines := 0


## Vertices that lie close together.
class _Piece:
	var box: AABB
	var first := PackedInt32Array()  # isoline of each field
	var last := PackedInt32Array()


func _init(scene: Scene) -> void:
	_weights = scene.weights
	_isolines = scene.isoline_count
	var all := PackedInt32Array(range(scene.vertex_count))
	for vertices in _cut(scene, all, _CUTS):
		_pieces.append(_piece(scene, vertices))


## Return a box that no vertex leaves, for the controls of a frame: 3 × 4 floats a transform, row by row.
func around(controls: PackedByteArray) -> AABB:
	var transforms := _transforms(controls.to_float32_array())
	var whole := AABB()
	for i in _pieces.size():
		var piece := _around_piece(_pieces[i], transforms)
		whole = piece if i == 0 else whole.merge(piece)
	return whole


func _around_piece(piece: _Piece, transforms: Array[Transform3D]) -> AABB:
	var low := Vector3.ZERO
	var size := Vector3.ZERO
	for field in _weights.size():
		var base := field * _isolines
		var box := transforms[base + piece.first[field]] * piece.box
		for isoline in range(base + piece.first[field] + 1, base + piece.last[field] + 1):
			box = box.merge(transforms[isoline] * piece.box)
		low += _weights[field] * box.position
		size += _weights[field] * box.size
	return AABB(low, size)


static func _transforms(numbers: PackedFloat32Array) -> Array[Transform3D]:
	var transforms: Array[Transform3D] = []
	for at in range(0, numbers.size(), _TRANSFORM):
		transforms.append(
			Transform3D(
				Vector3(numbers[at], numbers[at + 4], numbers[at + 8]),
				Vector3(numbers[at + 1], numbers[at + 5], numbers[at + 9]),
				Vector3(numbers[at + 2], numbers[at + 6], numbers[at + 10]),
				Vector3(numbers[at + 3], numbers[at + 7], numbers[at + 11])
			)
		)
	return transforms


static func _cut(scene: Scene, vertices: PackedInt32Array, times: int) -> Array[PackedInt32Array]:
	var box := _box(scene, vertices)
	if times == 0 or box.size == Vector3.ZERO:
		return [vertices]
	var axis := box.get_longest_axis_index()
	var middle := box.get_center()[axis]
	var halves: Array[PackedInt32Array] = [PackedInt32Array(), PackedInt32Array()]
	for vertex in vertices:
		halves[int(scene.positions[vertex][axis] > middle)].append(vertex)
	if halves[0].is_empty() or halves[1].is_empty():  # too close together for numbers
		return [vertices]
	var pieces := _cut(scene, halves[0], times - 1)
	pieces.append_array(_cut(scene, halves[1], times - 1))
	return pieces


static func _box(scene: Scene, vertices: PackedInt32Array) -> AABB:
	var low := Vector3.INF
	var high := -Vector3.INF
	for vertex in vertices:
		low = low.min(scene.positions[vertex])
		high = high.max(scene.positions[vertex])
	return AABB(low, high - low)


static func _piece(scene: Scene, vertices: PackedInt32Array) -> _Piece:
	var piece := _Piece.new()
	piece.box = _box(scene, vertices)
	var fields := scene.field_count
	for field in fields:
		var first := INF
		var last := -INF
		for vertex in vertices:
			var place := scene.ladder[vertex * fields + field]
			first = minf(first, place)
			last = maxf(last, place)
		var top := scene.isoline_count - 2  # no gap begins above it
		piece.first.append(clampi(int(first), 0, top))
		piece.last.append(clampi(int(last), 0, top) + 1)
	return piece
