extends "demo_scene.gd"
## Runs the film scene: records a take, plays it, records another one over it, plays both between two seconds, and
## returns to the live characters. With a path for an image, it saves an image as soon as there is a performer, and
## ends.

var _film: Node
var _live: Puppet3D
var _timeline: Node
var _transport: Node


func start() -> void:
	_film = open("res://demo/film/film.tscn")
	_live = _film.get_node(^"Live")
	_timeline = _film.get_node(^"Timeline")
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
	await _record(0)
	_play(0)
	await _until(func() -> bool: return _timeline.get(&"state").get("takes", []).size() == 1)
	var played: Dictionary = _timeline.get(&"state")["takes"][0]
	tell({"played": played})
	await _loop(true)
	await _record(1)
	_play(1)
	await _until(func() -> bool: return _timeline.get(&"state").get("takes", []).size() == 2)
	_press(^"%Pause")
	await _until(func() -> bool: return not _timeline.call(&"is_running"))
	await _loop(false)
	await _seek(0.5)
	_press(^"%From")
	await _seek(1.5)
	_press(^"%To")
	tell({"command": (_transport.get_node(^"%Told") as Label).text})
	await _seek(1.0)
	_press(^"%Pause")
	await _timeline.ended
	await _until(func() -> bool: return _timeline.get(&"state")["position"] >= 1.5)
	tell({"ended": _timeline.get(&"state")["position"]})
	_press(^"%Back")
	await _until(func() -> bool: return _timeline.get(&"state").is_empty())
	_film.call(&"_unhandled_input", _key(&"demo_shot_3"))
	quit()


func _play(number: int) -> void:
	var takes: ItemList = _transport.get_node(^"%Takes")
	takes.select(number)
	takes.item_selected.emit(number)
	(_transport.get_node(^"%Characters") as OptionButton).select(number)
	_press(^"%Play")


func _press(button: NodePath) -> void:
	(_transport.get_node(button) as Button).pressed.emit()


func _seek(seconds: float) -> void:
	(_transport.get_node(^"%Position") as Slider).set_value_no_signal(seconds)
	(_transport.get_node(^"%Position") as Slider).drag_ended.emit(true)
	await _until(func() -> bool: return _timeline.get(&"state")["position"] == seconds)


func _loop(on: bool) -> void:
	(_transport.get_node(^"%Loop") as CheckBox).button_pressed = on
	await _until(func() -> bool: return _timeline.get(&"state")["loop"] == on)


func _until(is_done: Callable) -> void:
	while not is_done.call():
		await process_frame


func _record(takes_before: int) -> void:
	while (_transport.get_node(^"%Record") as Button).disabled:
		await process_frame
	_transport.call(&"toggle_recording")
	await _live.take_started
	await create_timer(2.0).timeout
	_transport.call(&"toggle_recording")
	await _live.take_stopped
	var takes: ItemList = _transport.get_node(^"%Takes")
	while takes.item_count == takes_before:
		await process_frame


func _take_picture(path: String) -> void:
	await _record(0)
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
