extends SceneTree
## play.gd FILE N OUTBASE [SCENE]: play a .glb's first animation in Godot and write what every vertex does.
##
## The file is read as a game does it at run time (GLTFDocument), or SCENE is what the editor has imported it as. The N
## times are evenly spaced from 0 to the end of the animation, both included. What the graphics card does, morph targets
## and skin, is done here on the arrays that Godot keeps.
##
## OUTBASE.bin holds little-endian float32: for each surface (N, V, 3) world positions. OUTBASE.json is as that of
## play.mjs; no mesh has normals in it.


func _initialize() -> void:
	_play.call_deferred()


func _play() -> void:
	var arguments := OS.get_cmdline_user_args()
	var state := GLTFState.new()
	var document := GLTFDocument.new()
	if document.append_from_file(arguments[0], state) != OK:
		quit(1)
		return
	var imported := arguments.size() > 3
	var scene := (load(arguments[3]) as PackedScene).instantiate() if imported else document.generate_scene(state)
	root.add_child(scene)
	var player: AnimationPlayer = scene.find_children("*", "AnimationPlayer", true, false)[0]
	var animations: Array = state.json["animations"]
	player.play(animations[0]["name"] as String)
	var count := int(arguments[1])
	var times: Array[float] = []
	for index: int in count:
		times.append(player.current_animation_length * index / maxi(count - 1, 1))

	var surfaces: Array[Dictionary] = []
	for found: Node in scene.find_children("*", "MeshInstance3D", true, false):
		var instance: MeshInstance3D = found
		for surface: int in instance.mesh.get_surface_count():
			surfaces.append(_surface(state, instance, surface))
	var blocks: Array[PackedFloat32Array] = []
	blocks.resize(surfaces.size())
	for time: float in times:
		player.seek(time, true)
		for index: int in surfaces.size():
			blocks[index].append_array(_positions(surfaces[index]))
	_write(arguments[2], times, surfaces, blocks, scene, player)
	scene.free()
	quit()


func _surface(state: GLTFState, instance: MeshInstance3D, surface: int) -> Dictionary:
	var mesh: ArrayMesh = instance.mesh
	var arrays := mesh.surface_get_arrays(surface)
	var targets: Array[PackedVector3Array] = []
	for target: Array in mesh.surface_get_blend_shape_arrays(surface):
		targets.append(target[Mesh.ARRAY_VERTEX])
	return {
		"instance": instance,
		"surface": surface,
		"node": _node_of(state, instance),
		"base": arrays[Mesh.ARRAY_VERTEX],
		"targets": targets,
		"bones": arrays[Mesh.ARRAY_BONES],
		"weights": arrays[Mesh.ARRAY_WEIGHTS],
	}


## Return the node of the file that an instance shows the mesh of: it has the name that Godot gave that node.
func _node_of(state: GLTFState, instance: MeshInstance3D) -> int:
	for index: int in state.nodes.size():
		var node: GLTFNode = state.nodes[index]
		if node.mesh >= 0 and node.resource_name == instance.name:
			return index
	return -1


func _positions(surface: Dictionary) -> PackedFloat32Array:
	var instance: MeshInstance3D = surface["instance"]
	var base: PackedVector3Array = surface["base"]
	var points := base.duplicate()
	var targets: Array[PackedVector3Array] = surface["targets"]
	for number: int in targets.size():
		var weight := instance.get_blend_shape_value(number)
		if weight != 0:
			var target := targets[number]
			for vertex: int in points.size():
				points[vertex] += weight * (target[vertex] - base[vertex])
	if instance.skin != null and surface["bones"] != null:
		points = _skinned(instance, points, surface["bones"], surface["weights"])
	var flat := PackedFloat32Array()
	var to_world := instance.global_transform
	for point: Vector3 in points:
		var moved := to_world * point
		flat.append_array([moved.x, moved.y, moved.z])
	return flat


func _skinned(
	instance: MeshInstance3D, points: PackedVector3Array, bones: PackedInt32Array, weights: PackedFloat32Array
) -> PackedVector3Array:
	var skeleton: Skeleton3D = instance.get_node(instance.skeleton)
	var matrices: Array[Transform3D] = []
	for bind: int in instance.skin.get_bind_count():
		var bone := instance.skin.get_bind_bone(bind)
		if bone < 0:
			bone = skeleton.find_bone(instance.skin.get_bind_name(bind))
		matrices.append(skeleton.get_bone_global_pose(bone) * instance.skin.get_bind_pose(bind))
	var width := bones.size() / points.size()
	var moved := PackedVector3Array()
	for vertex: int in points.size():
		var sum := Vector3.ZERO
		for influence: int in range(vertex * width, (vertex + 1) * width):
			if weights[influence] != 0:
				sum += weights[influence] * (matrices[bones[influence]] * points[vertex])
		moved.append(sum)
	return moved


func _material(surface: Dictionary) -> Dictionary:
	var instance: MeshInstance3D = surface["instance"]
	var material: BaseMaterial3D = instance.get_active_material(surface["surface"] as int)
	if material == null:
		return {"name": "", "base_color": [1, 1, 1, 1], "images": []}
	var color := material.albedo_color.srgb_to_linear()
	var texture := material.albedo_texture
	return {
		"name": material.resource_name,
		"base_color": [color.r, color.g, color.b, color.a],
		"images":
		(
			[]
			if texture == null
			else [{"name": texture.resource_name, "size": [texture.get_width(), texture.get_height()]}]
		),
	}


func _targets(mesh: ArrayMesh) -> Array[String]:
	var names: Array[String] = []
	for number: int in mesh.get_blend_shape_count():
		names.append(mesh.get_blend_shape_name(number))
	return names


func _write(
	base: String,
	times: Array[float],
	surfaces: Array[Dictionary],
	blocks: Array[PackedFloat32Array],
	scene: Node,
	player: AnimationPlayer
) -> void:
	var binary := FileAccess.open(base + ".bin", FileAccess.WRITE)
	var meshes: Array[Dictionary] = []
	var start := 0
	for index: int in surfaces.size():
		var surface := surfaces[index]
		var instance: MeshInstance3D = surface["instance"]
		var points: PackedVector3Array = surface["base"]
		var own := {
			"name": instance.name,
			"node": surface["node"],
			"primitive": surface["surface"],
			"count": points.size(),
			"positions": start,
			"normals": null,
			"materials": [_material(surface)],
			"targets": _targets(instance.mesh as ArrayMesh),
		}
		meshes.append(own)
		start += blocks[index].size()
		binary.store_buffer(blocks[index].to_byte_array())
	binary.close()
	var objects: Array[String] = []
	for node: Node in scene.find_children("*", "", true, false):
		objects.append(node.name)
		if node is Skeleton3D:
			var skeleton: Skeleton3D = node
			for bone: int in skeleton.get_bone_count():
				objects.append(skeleton.get_bone_name(bone))
	var report := {
		"times": times,
		"meshes": meshes,
		"version": Engine.get_version_info()["string"],
		"animations": Array(player.get_animation_list()),
		"objects": objects,
	}
	var text := FileAccess.open(base + ".json", FileAccess.WRITE)
	text.store_string(JSON.stringify(report, "", false, true))
	text.close()
