extends "teller.gd"
## Reports the skeleton that Godot's importer made from a file, with the bone of a name turned about its x axis, and the
## places of the vertices: FILE BONE DEGREES.


func start() -> void:
	var scene := (load(arguments()[0]) as PackedScene).instantiate()
	root.add_child(scene)
	await process_frame
	var skeleton: Skeleton3D = scene.find_children("*", "Skeleton3D", true, false)[0]
	var bone := skeleton.find_bone(arguments()[1])
	var turn := Quaternion(Vector3.RIGHT, deg_to_rad(float(arguments()[2])))
	skeleton.set_bone_pose_rotation(bone, skeleton.get_bone_pose_rotation(bone) * turn)
	for number: int in skeleton.get_bone_count():
		var above := skeleton.get_bone_parent(number)
		tell(
			{
				"bone": skeleton.get_bone_name(number),
				"parent": skeleton.get_bone_name(above) if above >= 0 else "",
				"profile": _parent_in_profile(skeleton, number),
				"rest": _numbers(skeleton.get_bone_global_rest(number)),
			}
		)
	var instance: MeshInstance3D = scene.find_children("*", "MeshInstance3D", true, false)[0]
	tell({"before": _places(instance, null), "after": _places(instance, skeleton)})
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


## Return the x, y and z axes and the origin.
func _numbers(place: Transform3D) -> Array:
	var numbers := []
	for row: Vector3 in [place.basis.x, place.basis.y, place.basis.z, place.origin]:
		numbers.append_array([row.x, row.y, row.z])
	return numbers


## Return the vertices in base 64, as the skeleton moves them or as they are in the mesh.
func _places(instance: MeshInstance3D, skeleton: Skeleton3D) -> String:
	var arrays := (instance.mesh as ArrayMesh).surface_get_arrays(0)
	var positions: PackedVector3Array = arrays[Mesh.ARRAY_VERTEX]
	if skeleton != null:
		var bones: PackedInt32Array = arrays[Mesh.ARRAY_BONES]
		var weights: PackedFloat32Array = arrays[Mesh.ARRAY_WEIGHTS]
		var width := bones.size() / positions.size()
		for vertex: int in positions.size():
			var place := Vector3.ZERO
			for each: int in range(vertex * width, (vertex + 1) * width):
				var bone := skeleton.find_bone(instance.skin.get_bind_name(bones[each]))
				var bind := instance.skin.get_bind_pose(bones[each])
				place += weights[each] * (skeleton.get_bone_global_pose(bone) * (bind * positions[vertex]))
			positions[vertex] = place
	return base64(positions.to_byte_array())
