extends "patch_motion.gd"
## The motion of a patch by morph targets: the sums at rest, and those of each target's displacements.

const Scene := preload("../wire/scene.gd")
const MorphMesh := preload("morph_mesh.gd")

## Size of the residual before the weights of a frame, in floats.
const _RESIDUAL_FLOATS := 1

var _rest := PackedVector3Array([Vector3.ZERO, Vector3.ZERO, Vector3.ZERO])
## By target: the sums of its displacements.
var _targets: Array[PackedVector3Array] = []


## [param candidates] are the vertices of the imported meshes near the patch. The importer has an order of its own, so
## each vertex of the patch is the nearest candidate. [param source] is the transform of the source at rest.
func _init(scene: Scene, of: SurfacePatch, candidates: Array[MorphMesh.Vertex], source: Transform3D) -> void:
	patch = of
	for i in of.vertices.size():
		var position := source * scene.positions[of.vertices[i]]
		var nearest: MorphMesh.Vertex = null
		for candidate in candidates:
			var distance := position.distance_squared_to(candidate.position)
			if nearest == null or distance < position.distance_squared_to(nearest.position):
				nearest = candidate
		_add(_rest, i, position)
		var displacements := nearest.displacements() if nearest != null else PackedVector3Array()
		for target in displacements.size():
			if target == _targets.size():
				_targets.append(PackedVector3Array([Vector3.ZERO, Vector3.ZERO, Vector3.ZERO]))
			_add(_targets[target], i, displacements[target])


func evaluate(frame: Message) -> PackedVector3Array:
	var weights := frame.payload.to_float32_array()
	var sums := _rest.duplicate()
	for target in _targets.size():
		var weight := weights[_RESIDUAL_FLOATS + target]
		for i in 3:
			sums[i] += weight * _targets[target][i]
	return sums


func _add(sums: PackedVector3Array, i: int, position: Vector3) -> void:
	sums[0] += patch.to_origin[i] * position
	sums[1] += patch.to_first[i] * position
	sums[2] += patch.to_z[i] * position
