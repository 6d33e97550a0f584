extends "teller.gd"
## Builds a skeleton of which a file describes the bones, drives it by the recorded messages of a scene and a frame, and
## prints the global poses of its bones.

const Message := preload("res://addons/puppetline/wire/message.gd")


func start() -> void:
	var told: Dictionary = JSON.parse_string(FileAccess.get_file_as_string(arguments()[0]))
	var skeleton := Skeleton3D.new()
	for bone: Dictionary in told["bones"]:
		skeleton.add_bone(bone["name"].replace(":", "_"))
		var index := skeleton.get_bone_count() - 1
		skeleton.set_bone_parent(index, int(bone["parent"]))
		var turn: Array = bone["rotation"]
		var place: Array = bone["position"]
		var basis := Basis(Quaternion(turn[0], turn[1], turn[2], turn[3]).normalized())
		skeleton.set_bone_rest(index, Transform3D(basis, Vector3(place[0], place[1], place[2])))
		skeleton.reset_bone_pose(index)
	root.add_child(skeleton)
	var driver := PuppetSkeleton3D.new()
	driver.bone_map = told["map"]
	skeleton.add_child(driver)
	await process_frame
	driver._take_scene(Message.parse(FileAccess.get_file_as_bytes(arguments()[1])))
	for path: String in arguments().slice(2):
		driver._take_frame(Message.parse(FileAccess.get_file_as_bytes(path)))
	driver._process_modification()
	var poses: Array = []
	for bone in skeleton.get_bone_count():
		var pose := skeleton.get_bone_global_pose(bone)
		var turn := pose.basis.get_rotation_quaternion()
		poses.append([pose.origin.x, pose.origin.y, pose.origin.z, turn.x, turn.y, turn.z, turn.w])
	tell(
		{
			"driven": driver.driven_bones(),
			"poses": poses,
			"damaged": driver.statistics()["damaged"],
			"warnings": driver._get_configuration_warnings(),
		}
	)
	quit()
