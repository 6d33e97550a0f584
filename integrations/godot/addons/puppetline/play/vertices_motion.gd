extends "patch_motion.gd"
## The motion of a patch by the vertices of each frame.

## Size of a position, in bytes.
const _VECTOR_BYTES := 12


func _init(of: SurfacePatch) -> void:
	patch = of


func evaluate(frame: Message) -> PackedVector3Array:
	var sums := PackedVector3Array([Vector3.ZERO, Vector3.ZERO, Vector3.ZERO])
	for i in patch.vertices.size():
		var at := patch.vertices[i] * _VECTOR_BYTES
		var payload := frame.payload
		var position := Vector3(payload.decode_float(at), payload.decode_float(at + 4), payload.decode_float(at + 8))
		sums[0] += patch.to_origin[i] * position
		sums[1] += patch.to_first[i] * position
		sums[2] += patch.to_z[i] * position
	return sums
