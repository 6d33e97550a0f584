extends "teller.gd"
## Reports the values of the blend shapes "jaw" and "brow" of a skeleton's mesh, driven by the recorded messages of a
## scene and of frames, and when it has been left: INFLUENCE SCENE FRAME...

const Message := preload("res://addons/puppetline/wire/message.gd")


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
	for name: String in ["brow", "jaw"]:
		mesh.add_blend_shape(name)
	mesh.add_surface_from_arrays(Mesh.PRIMITIVE_TRIANGLES, arrays, [shape, shape])
	var instance := MeshInstance3D.new()
	instance.mesh = mesh
	instance.set_blend_shape_value(0, 0.3)
	instance.set_blend_shape_value(1, 0.25)
	var skeleton := Skeleton3D.new()
	var driver := PuppetSkeleton3D.new()
	driver.influence = float(arguments()[0])
	skeleton.add_child(instance)
	skeleton.add_child(driver)
	root.add_child(skeleton)
	driver._take_scene(Message.parse(FileAccess.get_file_as_bytes(arguments()[1])))
	for path: String in arguments().slice(2):
		driver._frames.clear()
		driver._take_frame(Message.parse(FileAccess.get_file_as_bytes(path)))
		driver._process_modification()
		tell({"values": [instance.get_blend_shape_value(0), instance.get_blend_shape_value(1)]})
	driver._disconnect()
	tell({"values": [instance.get_blend_shape_value(0), instance.get_blend_shape_value(1)]})
	skeleton.free()
	quit()
