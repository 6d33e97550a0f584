extends "teller.gd"
## Base of the scripts that run a scene of the demo, report events and save images.
##
## The arguments are the properties of its puppets as JSON, {"Live": {"character": "dog", "port": 7400}}, and optionally
## the path of an image.


func picture() -> String:
	return arguments()[1] if arguments().size() > 1 else ""


## Make a scene and set the properties of its puppets.
func open(path: String) -> Node:
	var scene := (load(path) as PackedScene).instantiate()
	var settings: Dictionary = JSON.parse_string(arguments()[0])
	for node: String in settings:
		for property: String in settings[node]:
			scene.get_node(node).set(property, settings[node][property])
	# The window is small until the scene is ready, because a software renderer may draw it.
	root.scaling_3d_scale = 0.15 if picture() else 1.0
	return scene


func save(path: String) -> void:
	await process_frame
	await RenderingServer.frame_post_draw
	root.get_texture().get_image().save_png(path)
	tell({"picture": path})
