extends Control
## Controls that record takes, play them on characters, and trim what is filmed. The service records and plays.

const Timeline := preload("res://demo/film/timeline.gd")

## Time until a failed request is repeated, in seconds.
const RETRY_SECONDS := 2.0
## Count-in of a take that is recorded while others play, in seconds.
const COUNT_IN_SECONDS := 3

## Command that writes the film. Its placeholder are the takes.
@export var command := "godot --write-movie film.avi --fixed-fps 30 demo/film/film.tscn -- %s"

var _puppet: Puppet3D
var _timeline: Timeline
var _recording := false
var _seconds := 0.0

@onready var _record: Button = %Record
@onready var _clock: Label = %Clock
@onready var _takes: ItemList = %Takes
@onready var _characters: OptionButton = %Characters
@onready var _play: Button = %Play
@onready var _playing: Control = %Playing
@onready var _pause: Button = %Pause
@onready var _position: HSlider = %Position
@onready var _told: Label = %Told
@onready var _copy: Button = %Copy


func _ready() -> void:
	_record.pressed.connect(toggle_recording)
	_play.pressed.connect(_on_play_pressed)
	_pause.pressed.connect(func() -> void: _timeline.pause(_timeline.is_running()))
	%Loop.toggled.connect(func(on: bool) -> void: _timeline.loop(on))
	%Back.pressed.connect(func() -> void: _timeline.stop())
	%From.pressed.connect(func() -> void: _trim(_timeline.position, _timeline.last))
	%To.pressed.connect(func() -> void: _trim(_timeline.first, _timeline.position))
	_position.drag_ended.connect(func(_changed: bool) -> void: _timeline.seek(_position.value))
	_copy.pressed.connect(func() -> void: DisplayServer.clipboard_set(_told.text))
	_takes.item_selected.connect(func(_index: int) -> void: _play.disabled = false)
	_record.disabled = true
	_tell("")
	_show_recording(false)


func _process(delta: float) -> void:
	if _recording:
		_seconds += delta
		_clock.text = "%02d:%04.1f" % [int(_seconds / 60.0), fmod(_seconds, 60.0)]
	if _playing.visible and not Input.is_mouse_button_pressed(MOUSE_BUTTON_LEFT):
		_position.set_value_no_signal(_timeline.position)


## Choose the puppet whose performer is recorded, and the takes that play.
func follow(puppet: Puppet3D, timeline: Timeline) -> void:
	_puppet = puppet
	_timeline = timeline
	timeline.changed.connect(_show_timeline)
	puppet.connected.connect(_ask)
	puppet.disconnected.connect(func() -> void: _record.disabled = true)
	puppet.take_started.connect(func(_take: String) -> void: _show_recording(true))
	puppet.take_stopped.connect(_on_take_stopped)


## Start or stop recording. Takes that play are recorded over: they begin again after a count-in.
func toggle_recording() -> void:
	if _record.disabled:
		return
	if _recording:
		_puppet.stop_recording(_on_recorded)
	else:
		_puppet.start_recording("", _on_recorded, 0 if _timeline.state.is_empty() else COUNT_IN_SECONDS)


## Return the text of a failed reply.
static func text_of_error(reply: Dictionary) -> String:
	var error: Dictionary = reply.get("error", {})
	return "Found %s; expected %s. %s" % [error.get("found"), error.get("expected"), error.get("fix")]


func _ask() -> void:
	_puppet.request({"do": "list"}, _on_listed)


func _on_listed(reply: Dictionary) -> void:
	if not _is_well(reply):
		get_tree().create_timer(RETRY_SECONDS).timeout.connect(_ask)
		return
	if _record.disabled:
		_record.disabled = false
		_tell("")
	_takes.clear()
	_play.disabled = true
	var result: Dictionary = reply["result"]
	for take: Dictionary in result.get("takes", []):
		var index := _takes.add_item(take.get("name", "?"))
		_takes.set_item_tooltip(index, String.humanize_size(int(take.get("bytes", 0))))
	if _characters.item_count == 0:
		for character: String in result.get("characters", []):
			_characters.add_item(character)


func _on_recorded(reply: Dictionary) -> void:
	if _is_well(reply):
		var result: Dictionary = reply["result"]
		_tell("")
		_show_recording(not result.has("bytes"))
		_ask()


func _on_take_stopped(_take: String) -> void:
	_show_recording(false)
	_ask()


func _on_play_pressed() -> void:
	var chosen := _takes.get_selected_items()
	if not chosen.is_empty():
		_timeline.play(_characters.get_item_text(_characters.selected), _takes.get_item_text(chosen[0]), _is_well)


## Choose the seconds that are played and filmed.
func _trim(first: float, last: float) -> void:
	_timeline.first = minf(first, last)
	_timeline.last = maxf(first, last)
	_show_timeline()


func _show_timeline() -> void:
	var state := _timeline.state
	_playing.visible = not state.is_empty()
	if state.is_empty():
		_tell("")
		return
	_position.min_value = floorf(state["start"])  # its steps count from here
	_position.max_value = state["end"]
	_pause.text = "Continue" if state["paused"] else "Pause"
	var takes: Array = state["takes"].map(
		func(each: Dictionary) -> String: return "%s=%s" % [each["character"], each["take"]]
	)
	if _timeline.first > state["start"]:
		takes.append("from=%.2f" % _timeline.first)
	if _timeline.last < state["end"]:
		takes.append("to=%.2f" % _timeline.last)
	_tell(command % " ".join(takes))
	_copy.show()


func _show_recording(on: bool) -> void:
	if on and not _recording:
		_seconds = 0.0
	_recording = on
	_record.text = "Stop" if on else "Record"
	_clock.visible = on


func _is_well(reply: Dictionary) -> bool:
	if reply.get("ok", false):
		return true
	_tell(text_of_error(reply))
	return false


func _tell(what: String) -> void:
	_copy.hide()
	_told.text = what
	_told.visible = not what.is_empty()
