extends "teller.gd"
## Prints which of some joints are which bones of skeletons, whose names are in a file.

const BoneNames := preload("res://addons/puppetline/play/bone_names.gd")


func start() -> void:
	var told: Dictionary = JSON.parse_string(FileAccess.get_file_as_string(arguments()[0]))
	var found: Array = []
	for names: Array in told["skeletons"]:
		var bones: Dictionary = BoneNames.new().find_bones(PackedStringArray(names))
		for bone: String in bones.keys():
			if bone not in told["joints"]:
				bones.erase(bone)
		found.append(bones)
	tell({"found": found})
	quit()
