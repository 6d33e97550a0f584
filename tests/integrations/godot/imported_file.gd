extends "teller.gd"
## Reports the arrays of each surface that Godot's importer made from a file, in base 64.


func start() -> void:
	var scene := (load(arguments()[0]) as PackedScene).instantiate()
	root.add_child(scene)
	await process_frame
	for found: Node in scene.find_children("*", "MeshInstance3D", true, false):
		var instance: MeshInstance3D = found
		var mesh: ArrayMesh = instance.mesh
		for surface: int in mesh.get_surface_count():
			_tell_surface(instance, mesh, surface)
	scene.free()
	quit()


func _tell_surface(instance: MeshInstance3D, mesh: ArrayMesh, surface: int) -> void:
	var arrays := mesh.surface_get_arrays(surface)
	var material: Material = instance.get_active_material(surface)
	var positions: PackedVector3Array = arrays[Mesh.ARRAY_VERTEX]
	var result := {
		"name": instance.name,
		"material": material.resource_name if material != null else "",
		"compressed": mesh.surface_get_format(surface) & Mesh.ARRAY_FLAG_COMPRESS_ATTRIBUTES != 0,
		"identity": instance.global_transform.is_equal_approx(Transform3D.IDENTITY),
		"positions": base64(positions.to_byte_array()),
		"triangles": base64((arrays[Mesh.ARRAY_INDEX] as PackedInt32Array).to_byte_array()),
	}
	for custom: int in 3:
		var numbers: PackedFloat32Array = arrays[Mesh.ARRAY_CUSTOM0 + custom]
		result["custom_%d" % custom] = base64(numbers.to_byte_array())
	tell(result)
