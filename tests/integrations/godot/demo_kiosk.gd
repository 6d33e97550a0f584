extends "demo_scene.gd"
## Runs the kiosk scene: reports lights and attract mode, and ends when attract mode begins again.
## With a path for an image, it waits for both characters instead, and saves an image.

var _kiosk: Node


func start() -> void:
	_kiosk = open("res://demo/kiosk/kiosk.tscn")
	_kiosk.connect(&"attracting_changed", _on_attracting_changed)
	for side: String in ["Left", "Right"]:
		var place := _kiosk.get_node(side)
		place.connect(&"taken_changed", func(on: bool) -> void: tell({"taken": side, "on": on}))
		var puppet: Puppet3D = place.get_node(^"Puppet")
		puppet.scene_loaded.connect(func() -> void: tell({"loaded": side}))
		puppet.performer_calibrated.connect(func(user: int) -> void: tell({"calibrated": side, "user": user}))
	root.add_child(_kiosk)
	tell({"attracting": _kiosk.get(&"attracting")})
	if picture():
		_take_picture(picture())


func _on_attracting_changed(on: bool) -> void:
	tell({"attracting": on, "prompt": (_kiosk.get_node(^"Screen/Prompt") as Label).visible})
	if on and not picture():
		quit()


func _take_picture(path: String) -> void:
	while not ["Left", "Right"].all(func(side: String) -> bool: return _kiosk.get_node(side).get(&"taken")):
		await process_frame
	await create_timer(2.0).timeout
	root.scaling_3d_scale = 1.0
	await save(path)
	for side: String in ["Left", "Right"]:
		(_kiosk.get_node(side).get_node(^"Puppet") as Puppet3D).hide()
	await save(path.replace(".png", "_empty.png"))
	quit()
