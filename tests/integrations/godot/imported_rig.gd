extends "teller.gd"
## Reports the skeleton that Godot's importer made from a file: FILE.


func start() -> void:
	var scene := (load(arguments()[0]) as PackedScene).instantiate()
	root.add_child(scene)
	await process_frame
	var skeleton: Skeleton3D = scene.find_children("*", "Skeleton3D", true, false)[0]
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
