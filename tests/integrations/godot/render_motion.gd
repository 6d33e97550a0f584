extends "photographer.gd"
## Draws a character whose shadow by a spot light moves between two frames, and from far away with and without levels
## of detail: FOLDER.

## Number of images after which a light has drawn its shadows for the last time.
const _SETTLING_IMAGES := 3


func start() -> void:
	open(arguments()[0])
	make_stage()
	await _draw_shadows()
	await _draw_levels()
	resources = null
	quit()


## Only the share changes between the images: first on the way, then from the start.
func _draw_shadows() -> void:
	var light := SpotLight3D.new()
	var box := resources.scene.bounds
	light.spot_range = 4.0 * box.size.length()
	light.spot_angle = 40.0
	light.light_energy = 8.0
	light.shadow_enabled = true
	light.look_at_from_position(box.get_center() + Vector3(0.9, 1.5, 0.3) * box.size.length(), box.get_center())
	stage.add_child(light)
	var frames: Array[Message] = [message("rest"), message("bent")]
	for shares: Array in [[0.0, 0.75], [0.75]]:
		var body := ControlsBody.new(resources, null)
		body.set_materials([])
		stage.add_child(body)
		for share: float in shares:
			body.show_frames(frames[0], frames[1], share)
			for _image in _SETTLING_IMAGES:
				await RenderingServer.frame_post_draw
			await save("shadow %s of %d" % [share, shares.size()])
		body.free()
	light.free()


func _draw_levels() -> void:
	stage.mesh_lod_threshold = 1.0
	camera.position = 3.0 * (camera.position - resources.scene.bounds.get_center())
	for bias: float in [1.0, 100.0]:
		var body := shown(ControlsBody.new(resources, null), "bent", null)
		var instance: MeshInstance3D = body.find_children("*", "MeshInstance3D", true, false)[0]
		instance.lod_bias = bias
		stage.add_child(body)
		await save("levels %d" % bias)
		var info := Viewport.RENDER_INFO_PRIMITIVES_IN_FRAME
		tell({"bias": bias, "triangles": stage.get_render_info(Viewport.RENDER_INFO_TYPE_VISIBLE, info)})
		body.free()
