extends "patch_motion.gd"
## The motion of a patch by the vertices of each frame.

const Vertices16 := preload("vertices16.gd")


func _init(of: SurfacePatch) -> void:
	patch = of


func evaluate(frame: Message) -> PackedVector3Array:
	var box := Vertices16.box(frame.payload)
	var sums := PackedVector3Array([Vector3.ZERO, Vector3.ZERO, Vector3.ZERO])
	for i in patch.vertices.size():
		var position := Vertices16.position(frame.payload, box, patch.vertices[i])
		sums[0] += patch.to_origin[i] * position
		sums[1] += patch.to_first[i] * position
		sums[2] += patch.to_z[i] * position
	return sums
