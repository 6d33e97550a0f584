extends "teller.gd"
## Reads a file of `puppetline rig`, tells its bones beside those of Godot's humanoid, and turns a bone about its own x
## axis: FILE, BONE, degrees.


func start() -> void:
	var document := GLTFDocument.new()
	var state := GLTFState.new()
	document.append_from_file(arguments()[0], state)
	var scene: Node3D = document.generate_scene(state)
	root.add_child(scene)
	var skeleton: Skeleton3D = scene.find_children("*", "Skeleton3D", true, false)[0]
	var bones: Array[Dictionary] = []
	for bone in skeleton.get_bone_count():
		var rest := skeleton.global_transform * skeleton.get_bone_global_rest(bone)
		var parent := skeleton.get_bone_parent(bone)
		(
			bones
			. append(
				{
					"name": skeleton.get_bone_name(bone),
					"parent": skeleton.get_bone_name(parent) if parent >= 0 else "",
					"profile": _parent_in_profile(skeleton, bone),
					"place": [rest.origin.x, rest.origin.y, rest.origin.z],
					"along": [rest.basis.y.x, rest.basis.y.y, rest.basis.y.z],
					"across": [rest.basis.x.x, rest.basis.x.y, rest.basis.x.z],
				}
			)
		)
	var mesh: MeshInstance3D = scene.find_children("*", "MeshInstance3D", true, false)[0]
	tell({"bones": bones, "rest": _positions(mesh)})
	var turned := skeleton.find_bone(arguments()[1])
	var turn := Quaternion(Vector3.RIGHT, deg_to_rad(arguments()[2].to_float()))
	skeleton.set_bone_pose_rotation(turned, skeleton.get_bone_rest(turned).basis.get_rotation_quaternion() * turn)
	skeleton.force_update_all_bone_transforms()
	tell({"turned": _positions(mesh)})
	scene.free()
	quit()


## Return the nearest bone above in Godot's humanoid that the skeleton has; null for a bone that the humanoid has not.
func _parent_in_profile(skeleton: Skeleton3D, bone: int) -> Variant:
	var profile := SkeletonProfileHumanoid.new()
	var name: StringName = skeleton.get_bone_name(bone)
	if profile.find_bone(name) < 0:
		return null
	name = profile.get_bone_parent(profile.find_bone(name))
	while name and skeleton.find_bone(name) < 0:
		name = profile.get_bone_parent(profile.find_bone(name))
	return name


## Return the positions that the weights and the bones give; a display server without images bakes no mesh.
func _positions(mesh: MeshInstance3D) -> String:
	var skeleton: Skeleton3D = mesh.get_node(mesh.skeleton)
	var moves: Array[Transform3D] = []
	for bind in mesh.skin.get_bind_count():
		var bone := mesh.skin.get_bind_bone(bind)
		bone = bone if bone >= 0 else skeleton.find_bone(mesh.skin.get_bind_name(bind))
		moves.append(skeleton.global_transform * skeleton.get_bone_global_pose(bone) * mesh.skin.get_bind_pose(bind))
	var arrays := mesh.mesh.surface_get_arrays(0)
	var bones: PackedInt32Array = arrays[Mesh.ARRAY_BONES]
	var weights: PackedFloat32Array = arrays[Mesh.ARRAY_WEIGHTS]
	var positions: PackedVector3Array = arrays[Mesh.ARRAY_VERTEX]
	var shown := PackedVector3Array()
	for vertex in positions.size():
		var sum := Vector3.ZERO
		for k in range(4 * vertex, 4 * vertex + 4):
			sum += weights[k] * (moves[bones[k]] * positions[vertex])
		shown.append(sum)
	return base64(shown.to_byte_array())
