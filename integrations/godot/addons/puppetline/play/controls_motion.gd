extends "patch_motion.gd"
## The motion of a patch by controls. The position of a vertex is a weighted sum of the isolines' transforms of its rest
## position, so a sum of positions is one of the transforms of a few points.

const Scene := preload("../wire/scene.gd")

## Row of each isoline's transform in a frame.
var _rows := PackedInt32Array()
## Three points of each isoline, whose transforms sum up to the origin, the first axis and the z axis: at rest, and then
## their displacements by each of the mesh's own targets.
var _points: Array[PackedVector4Array] = []


func _init(scene: Scene, of: SurfacePatch) -> void:
	patch = of
	for _i in 1 + scene.displacement_count:
		_points.append(PackedVector4Array())
	var last := scene.isoline_count - 2
	for i in patch.vertices.size():
		var vertex := patch.vertices[i]
		var points := PackedVector4Array([_of(scene.positions[vertex], 1.0)])
		for target in scene.displacement_count:
			points.append(_of(scene.displacements[target * scene.vertex_count + vertex], 0.0))
		for field in scene.field_count:
			var coordinate := scene.isoline_coordinates[vertex * scene.field_count + field]
			var isoline := clampi(int(coordinate), 0, last)
			var above := scene.weights[field] * (coordinate - isoline)
			var transform := field * scene.isoline_count + isoline
			_add(transform, i, scene.weights[field] - above, points)
			_add(transform + 1, i, above, points)


func evaluate(frame: Message) -> PackedVector3Array:
	var rows := frame.rows()
	var points := _shown_points(frame.targets)
	var origin := Vector4.ZERO
	var first := Vector4.ZERO
	var z := Vector4.ZERO
	var at := 0
	for row in _rows:
		# The rows become columns, so point * transform transforms a point.
		var transform := Projection(rows[row], rows[row + 1], rows[row + 2], Vector4.ZERO)
		origin += points[at] * transform
		first += points[at + 1] * transform
		z += points[at + 2] * transform
		at += 3
	return PackedVector3Array(
		[Vector3(origin.x, origin.y, origin.z), Vector3(first.x, first.y, first.z), Vector3(z.x, z.y, z.z)]
	)


func _shown_points(targets: PackedFloat32Array) -> PackedVector4Array:
	var points := _points[0].duplicate()
	for target in mini(targets.size(), _points.size() - 1):
		for i in points.size() if targets[target] > 0.0 else 0:
			points[i] += targets[target] * _points[1 + target][i]
	return points


## Add a share of a transform at a vertex of the patch: the vertex at rest, and its displacements.
func _add(transform: int, i: int, share: float, points: PackedVector4Array) -> void:
	if share == 0.0:
		return
	var entry := _rows.find(3 * transform)
	if entry < 0:
		entry = _rows.size()
		_rows.append(3 * transform)
		for each in _points:
			each.resize(3 * _rows.size())
	for k in points.size():
		_points[k][3 * entry] += share * patch.to_origin[i] * points[k]
		_points[k][3 * entry + 1] += share * patch.to_first[i] * points[k]
		_points[k][3 * entry + 2] += share * patch.to_z[i] * points[k]


static func _of(vector: Vector3, w: float) -> Vector4:
	return Vector4(vector.x, vector.y, vector.z, w)
