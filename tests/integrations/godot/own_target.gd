extends "teller.gd"
## Reports the value of a blend shape whose weight at rest is 0.25, for weights of the mesh's own target "jaw".

const MorphMesh := preload("res://addons/puppetline/play/morph_mesh.gd")


func start() -> void:
	var arrays := []
	arrays.resize(Mesh.ARRAY_MAX)
	arrays[Mesh.ARRAY_VERTEX] = PackedVector3Array([Vector3.ZERO, Vector3.RIGHT, Vector3.UP])
	arrays[Mesh.ARRAY_NORMAL] = PackedVector3Array([Vector3.BACK, Vector3.BACK, Vector3.BACK])
	var shape := []
	shape.resize(Mesh.ARRAY_MAX)
	shape[Mesh.ARRAY_VERTEX] = PackedVector3Array([Vector3.ZERO, Vector3.RIGHT, Vector3.UP * 2.0])
	shape[Mesh.ARRAY_NORMAL] = arrays[Mesh.ARRAY_NORMAL]
	var mesh := ArrayMesh.new()
	mesh.add_blend_shape("jaw")
	mesh.add_surface_from_arrays(Mesh.PRIMITIVE_TRIANGLES, arrays, [shape])
	var instance := MeshInstance3D.new()
	instance.mesh = mesh
	instance.set_blend_shape_value(0, 0.25)
	var morphs := MorphMesh.new()
	morphs.instance = instance
	for weight: float in [0.0, 0.4, 1.0]:
		for target: String in ["jaw", "brow"]:
			morphs.set_target(target, weight)
		tell({"value": instance.get_blend_shape_value(0)})
	instance.free()
	quit()
