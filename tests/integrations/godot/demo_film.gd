extends SceneTree
## The film scene: records a take, asks how to play it, waits until that is seen and goes back to the live performance.
##
## Takes what its puppets are to be, as JSON: {"Live": {"character": "dog", "port": 7400}}. If there is a second
## argument, it saves a picture there once somebody performs, and ends.

var _film: Node
var _live: Puppet3D
var _played: Puppet3D
var _transport: Node


func _initialize() -> void:
	var arguments := OS.get_cmdline_user_args()
	_film = (load("res://demo/film/film.tscn") as PackedScene).instantiate()
	var settings: Dictionary = JSON.parse_string(arguments[0])
	for path: String in settings:
		for property: String in settings[path]:
			_film.get_node(path).set(property, settings[path][property])
	_live = _film.get_node(^"Live")
	_played = _film.get_node(^"Played")
	_transport = _film.get_node(^"Screen/Transport")
	_film.get_node(^"Camera").connect(&"cut", func(shot: String) -> void: _tell({"cut": shot}))
	_live.take_started.connect(func(take: String) -> void: _tell({"started": take}))
	_live.take_stopped.connect(func(take: String) -> void: _tell({"stopped": take}))
	# few pixels until everything stands as it should: they may be drawn by the processor
	root.scaling_3d_scale = 0.15 if arguments.size() > 1 else 1.0
	root.add_child(_film)
	await _live.performer_calibrated
	_tell({"performing": true})
	if arguments.size() > 1:
		_take_picture(arguments[1])
	else:
		_record_and_play()


func _record_and_play() -> void:
	await _record()
	var takes: ItemList = _transport.get_node(^"%Takes")
	takes.select(0)
	takes.item_selected.emit(0)
	(_transport.get_node(^"%Play") as Button).pressed.emit()
	_tell({"command": (_transport.get_node(^"%Told") as Label).text, "take": takes.get_item_text(0)})
	while not _played.visible:
		await process_frame
	_tell({"played": true, "live": _live.visible})
	(_transport.get_node(^"%Back") as Button).pressed.emit()
	_tell({"played": _played.visible, "live": _live.visible})
	_film.call(&"_unhandled_input", _key(&"demo_shot_3"))
	quit()


func _record() -> void:
	while (_transport.get_node(^"%Record") as Button).disabled:
		await process_frame
	_transport.call(&"toggle_recording")
	await _live.take_started
	await create_timer(2.0).timeout
	_transport.call(&"toggle_recording")
	await _live.take_stopped
	var takes: ItemList = _transport.get_node(^"%Takes")
	while takes.item_count == 0:
		await process_frame


func _take_picture(path: String) -> void:
	await _record()
	_transport.call(&"toggle_recording")
	await _live.take_started
	await create_timer(3.0).timeout
	_film.get_node(^"Camera").call(&"cut_to", 1)
	root.scaling_3d_scale = 1.0
	await _save(path)
	_transport.call(&"toggle_recording")
	await _live.take_stopped
	_live.hide()
	await _save(path.replace(".png", "_empty.png"))
	quit()


func _save(path: String) -> void:
	await process_frame
	await RenderingServer.frame_post_draw
	root.get_texture().get_image().save_png(path)
	_tell({"picture": path})


func _key(action: StringName) -> InputEventAction:
	var event := InputEventAction.new()
	event.action = action
	event.pressed = true
	return event


func _tell(what: Dictionary) -> void:
	print("RESULT ", JSON.stringify(what))
