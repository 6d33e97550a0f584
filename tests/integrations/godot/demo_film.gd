extends "demo_scene.gd"
## Runs the film scene: records a take, requests its playback, waits until it is shown and returns to the live
## character. With a path for an image, it saves an image as soon as there is a performer, and ends.

var _film: Node
var _live: Puppet3D
var _played: Puppet3D
var _transport: Node


func start() -> void:
	_film = open("res://demo/film/film.tscn")
	_live = _film.get_node(^"Live")
	_played = _film.get_node(^"Played")
	_transport = _film.get_node(^"Screen/Transport")
	_film.get_node(^"Camera").connect(&"cut", func(shot: String) -> void: tell({"cut": shot}))
	_live.take_started.connect(func(take: String) -> void: tell({"started": take}))
	_live.take_stopped.connect(func(take: String) -> void: tell({"stopped": take}))
	root.add_child(_film)
	await _live.performer_calibrated
	tell({"performing": true})
	if picture():
		_take_picture(picture())
	else:
		_record_and_play()


func _record_and_play() -> void:
	await _record()
	var takes: ItemList = _transport.get_node(^"%Takes")
	takes.select(0)
	takes.item_selected.emit(0)
	(_transport.get_node(^"%Play") as Button).pressed.emit()
	tell({"command": (_transport.get_node(^"%Told") as Label).text, "take": takes.get_item_text(0)})
	while not _played.visible:
		await process_frame
	tell({"played": true, "live": _live.visible})
	(_transport.get_node(^"%Back") as Button).pressed.emit()
	tell({"played": _played.visible, "live": _live.visible})
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
	await save(path)
	_transport.call(&"toggle_recording")
	await _live.take_stopped
	_live.hide()
	await save(path.replace(".png", "_empty.png"))
	quit()


func _key(action: StringName) -> InputEventAction:
	var event := InputEventAction.new()
	event.action = action
	event.pressed = true
	return event
