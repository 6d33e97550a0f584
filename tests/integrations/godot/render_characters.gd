extends "photographer.gd"
## Draws the bent characters of folders, two images each: a mesh of the bent vertices with Godot's own material, and the
## addon's version of it. Arguments: the beginning of the images' names, FOLDER...

const Materials := preload("res://addons/puppetline/play/materials.gd")


func start() -> void:
	for path in arguments().slice(1):
		open(path)
		make_stage()
		await _draw(arguments()[0])
		stage.free()
		resources = null
	quit()


func _draw(beginning: String) -> void:
	var own := MeshInstance3D.new()
	own.mesh = bent_mesh()
	own.material_override = Materials.of_scene(resources.scene)[0]
	await photograph(own, beginning + " own")
	await photograph(shown(ControlsBody.new(resources, null), "bent", null), beginning + " made")
	tell({"folder": folder})
