extends Control
## Controls that record and list takes. The service records the motion of the performer.

## Emitted when a take is to be played.
signal play_asked(take: String)
## Emitted when the live character is to be shown again.
signal live_asked

## Time until a failed request is repeated, in seconds.
const RETRY_SECONDS := 2.0

var _puppet: Puppet3D
var _recording := false
var _seconds := 0.0

@onready var _record: Button = %Record
@onready var _clock: Label = %Clock
@onready var _takes: ItemList = %Takes
@onready var _play: Button = %Play
@onready var _back: Button = %Back
@onready var _told: Label = %Told
@onready var _copy: Button = %Copy


func _ready() -> void:
	_record.pressed.connect(toggle_recording)
	_play.pressed.connect(_on_play_pressed)
	_back.pressed.connect(_on_back_pressed)
	_copy.pressed.connect(func() -> void: DisplayServer.clipboard_set(_told.text))
	_takes.item_selected.connect(func(_index: int) -> void: _play.disabled = false)
	_record.disabled = true
	_tell("")
	_show_recording(false)


func _process(delta: float) -> void:
	if _recording:
		_seconds += delta
		_clock.text = "%02d:%04.1f" % [int(_seconds / 60.0), fmod(_seconds, 60.0)]


## Choose the puppet whose performer is recorded.
func follow(puppet: Puppet3D) -> void:
	_puppet = puppet
	puppet.connected.connect(_ask)
	puppet.disconnected.connect(func() -> void: _record.disabled = true)
	puppet.take_started.connect(func(_take: String) -> void: _show_recording(true))
	puppet.take_stopped.connect(_on_take_stopped)


## Start or stop recording.
func toggle_recording() -> void:
	if _record.disabled:
		return
	if _recording:
		_puppet.stop_recording(_on_recorded)
	else:
		_puppet.start_recording("", _on_recorded)


## Show a command to run in a terminal.
func show_command(command: String) -> void:
	_tell(command)
	_copy.show()


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
		_back.show()
		play_asked.emit(_takes.get_item_text(chosen[0]))


func _on_back_pressed() -> void:
	_back.hide()
	_tell("")
	live_asked.emit()


func _show_recording(on: bool) -> void:
	if on and not _recording:
		_seconds = 0.0
	_recording = on
	_record.text = "Stop" if on else "Record"
	_clock.visible = on


func _is_well(reply: Dictionary) -> bool:
	if reply.get("ok", false):
		return true
	var error: Dictionary = reply.get("error", {})
	_tell("Found %s; expected %s. %s" % [error.get("found"), error.get("expected"), error.get("fix")])
	return false


func _tell(what: String) -> void:
	_copy.hide()
	_told.text = what
	_told.visible = not what.is_empty()
