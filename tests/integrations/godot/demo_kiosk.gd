extends SceneTree
## The kiosk scene: says what lights up and when people are invited, and ends when they are invited again.
##
## Takes what its puppets are to be, as JSON: {"Left/Puppet": {"character": "dog", "port": 7400}}. If there is a second
## argument, it waits for both characters instead, and saves a picture there.

var _kiosk: Node
var _for_picture := false


func _initialize() -> void:
	var arguments := OS.get_cmdline_user_args()
	_kiosk = (load("res://demo/kiosk/kiosk.tscn") as PackedScene).instantiate()
	var settings: Dictionary = JSON.parse_string(arguments[0])
	for path: String in settings:
		for property: String in settings[path]:
			_kiosk.get_node(path).set(property, settings[path][property])
	_kiosk.connect(&"attracting_changed", _on_attracting_changed)
	for side: String in ["Left", "Right"]:
		var place := _kiosk.get_node(side)
		place.connect(&"taken_changed", func(on: bool) -> void: _tell({"taken": side, "on": on}))
		var puppet: Puppet3D = place.get_node(^"Puppet")
		puppet.scene_loaded.connect(func() -> void: _tell({"loaded": side}))
		puppet.performer_calibrated.connect(func(user: int) -> void: _tell({"calibrated": side, "user": user}))
	_for_picture = arguments.size() > 1
	# few pixels until everything stands as it should: they may be drawn by the processor
	root.scaling_3d_scale = 0.15 if _for_picture else 1.0
	root.add_child(_kiosk)
	_tell({"attracting": _kiosk.get(&"attracting")})
	if _for_picture:
		_take_picture(arguments[1])


func _on_attracting_changed(on: bool) -> void:
	_tell({"attracting": on, "prompt": (_kiosk.get_node(^"Screen/Prompt") as Label).visible})
	if on and not _for_picture:
		quit()


func _take_picture(path: String) -> void:
	while not ["Left", "Right"].all(func(side: String) -> bool: return _kiosk.get_node(side).get(&"taken")):
		await process_frame
	await create_timer(2.0).timeout
	root.scaling_3d_scale = 1.0
	await _save(path)
	for side: String in ["Left", "Right"]:
		(_kiosk.get_node(side).get_node(^"Puppet") as Puppet3D).hide()
	await _save(path.replace(".png", "_empty.png"))
	quit()


func _save(path: String) -> void:
	await process_frame
	await RenderingServer.frame_post_draw
	root.get_texture().get_image().save_png(path)
	_tell({"picture": path})


func _tell(what: Dictionary) -> void:
	print("RESULT ", JSON.stringify(what))
