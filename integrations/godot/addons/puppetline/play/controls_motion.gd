extends "patch_motion.gd"
## The motion of a patch by controls. The position of a vertex is a weighted sum of the isolines' transforms of its rest
## position, so a sum of positions is one of the transforms of a few points.

const Scene := preload("../wire/scene.gd")

## Row of each isoline's transform in a frame.
var _rows := PackedInt32Array()
## Three points of each isoline, whose transforms sum up to the origin, the first axis and the z axis.
var _points := PackedVector4Array()


func _init(scene: Scene, of: SurfacePatch) -> void:
	patch = of
	var last := scene.isoline_count - 2
	for i in patch.vertices.size():
		var vertex := patch.vertices[i]
		var rest := scene.positions[vertex]
		var point := Vector4(rest.x, rest.y, rest.z, 1.0)
		for field in scene.field_count:
			var coordinate := scene.isoline_coordinates[vertex * scene.field_count + field]
			var isoline := clampi(int(coordinate), 0, last)
			var above := scene.weights[field] * (coordinate - isoline)
			var transform := field * scene.isoline_count + isoline
			_add(transform, i, (scene.weights[field] - above) * point)
			_add(transform + 1, i, above * point)


func evaluate(frame: Message) -> PackedVector3Array:
	var rows := frame.rows()
	var origin := Vector4.ZERO
	var first := Vector4.ZERO
	var z := Vector4.ZERO
	var at := 0
	for row in _rows:
		# The rows become columns, so point * transform transforms a point.
		var transform := Projection(rows[row], rows[row + 1], rows[row + 2], Vector4.ZERO)
		origin += _points[at] * transform
		first += _points[at + 1] * transform
		z += _points[at + 2] * transform
		at += 3
	return PackedVector3Array(
		[Vector3(origin.x, origin.y, origin.z), Vector3(first.x, first.y, first.z), Vector3(z.x, z.y, z.z)]
	)


func _add(transform: int, i: int, point: Vector4) -> void:
	if point == Vector4.ZERO:
		return
	var entry := _rows.find(3 * transform)
	if entry < 0:
		entry = _rows.size()
		_rows.append(3 * transform)
		_points.resize(3 * _rows.size())
	_points[3 * entry] += patch.to_origin[i] * point
	_points[3 * entry + 1] += patch.to_first[i] * point
	_points[3 * entry + 2] += patch.to_z[i] * point
