extends "teller.gd"
## What scripts of the demo's scenes have in common: they open one, say things, and save pictures.
##
## They take what its puppets are to be, as JSON: {"Live": {"character": "dog", "port": 7400}}, and if there is a second
## argument, where a picture goes.


func picture() -> String:
	return arguments()[1] if arguments().size() > 1 else ""


## Make a scene whose puppets are as they shall be.
func open(path: String) -> Node:
	var scene := (load(path) as PackedScene).instantiate()
	var settings: Dictionary = JSON.parse_string(arguments()[0])
	for node: String in settings:
		for property: String in settings[node]:
			scene.get_node(node).set(property, settings[node][property])
	# few pixels until everything stands as it should: they may be drawn by the processor
	root.scaling_3d_scale = 0.15 if picture() else 1.0
	return scene


func save(path: String) -> void:
	await process_frame
	await RenderingServer.frame_post_draw
	root.get_texture().get_image().save_png(path)
	tell({"picture": path})
