extends Node
## The takes that the service plays on its characters, from a first to a last second, with the sounds beside them.
##
## The service keeps the time, or the engine while it films.

## Emitted with each status of the service.
signal changed
## Emitted when the last second has passed.
signal ended

## Largest difference between a sound and the timeline, in seconds.
const SOUND_TOLERANCE_SECONDS := 0.05

## Folder of the service's takes on this machine. If empty, takes have no sound.
@export_global_dir var takes_folder := ""

## The service's timeline as in its status (docs/control.md); empty if no take plays.
var state: Dictionary = {}
## First second that is played.
var first := 0.0
## Last second that is played.
var last := INF
## Second of the timeline that is shown.
var position := 0.0
## Whether the engine keeps the time, because the images of a movie wait for their frames.
var is_filmed := false

var _puppet: Puppet3D
var _sounds: Dictionary = {}  # name of a take: its player; null if it has no sound


func _process(delta: float) -> void:
	if not is_running():
		_sound()
		return
	position += delta * state["speed"]
	if position >= minf(last, state["end"]) and last < INF:
		ended.emit()
		if state["loop"]:
			position = first
			seek(first)
		else:
			state["paused"] = true
			pause(true)
	_sound()


## Choose the puppet whose service plays takes.
func follow(puppet: Puppet3D) -> void:
	_puppet = puppet
	puppet.timeline_received.connect(_take_state)


## Play a take on a character. [param done] is called with the service's reply.
func play(character: String, take: String, done: Callable) -> void:
	_puppet.request({"do": "play_take", "character": character, "take": take}, done)


func pause(on: bool, done := Callable()) -> void:
	_puppet.request({"do": "pause", "on": on}, _taking_state(done))


func seek(seconds: float, done := Callable()) -> void:
	_puppet.request({"do": "seek", "seconds": seconds}, _taking_state(done))


func loop(on: bool) -> void:
	_puppet.request({"do": "loop", "on": on}, _taking_state())


## Stop all takes. The characters get their performers back.
func stop() -> void:
	first = 0.0
	last = INF
	_puppet.request({"do": "stop"})


func is_running() -> bool:
	return not state.is_empty() and not state["paused"]


func _taking_state(done := Callable()) -> Callable:
	return func(reply: Dictionary) -> void:
		if reply.get("ok", false):
			_take_state(reply["result"])
		if done.is_valid():
			done.call(reply)


func _take_state(timeline: Dictionary) -> void:
	if is_filmed:
		return
	state = timeline
	position = state.get("position", 0.0)
	changed.emit()


## Let each take's sound play where the timeline is.
func _sound() -> void:
	var playing: Dictionary = {}
	for take: Dictionary in state.get("takes", []):
		var player := _player(take["take"])
		if player == null:
			continue
		playing[player] = true
		var second: float = position - take["at"] - player.get_meta(&"begin")
		if not is_running() or second < 0.0 or second >= player.stream.get_length():
			player.stop()
		elif not player.playing or absf(player.get_playback_position() - second) > SOUND_TOLERANCE_SECONDS:
			player.pitch_scale = state["speed"]
			player.play(second)
	for player: Variant in _sounds.values():
		if player != null and player not in playing:
			player.stop()


## Return the player of a take's sound; null if there is none.
func _player(take: String) -> AudioStreamPlayer:
	if take not in _sounds:
		_sounds[take] = _load(take)
	return _sounds[take]


func _load(take: String) -> AudioStreamPlayer:
	var cue: Dictionary = {}
	var begin := NAN
	var log_file := FileAccess.open(takes_folder.path_join(take + ".log"), FileAccess.READ) if takes_folder else null
	while log_file != null and not log_file.eof_reached() and cue.is_empty():
		var line := log_file.get_line()
		if is_nan(begin) or '"sound"' in line:
			var event: Variant = JSON.parse_string(line)
			begin = event["t"] if is_nan(begin) and event is Dictionary and event.has("t") else begin
			cue = event["arguments"] if event is Dictionary and event.get("do") == "sound" else {}
	if cue.is_empty():
		return null
	# by name, because Godot 4.3 cannot load such a file
	var path := takes_folder.path_join(String(cue["file"]).get_file())
	var stream: Variant = ClassDB.class_call_static(&"AudioStreamWAV", &"load_from_file", path, {})
	if stream == null:
		return null
	var player := AudioStreamPlayer.new()
	player.stream = stream
	player.set_meta(&"begin", float(cue["at"]) - begin)
	add_child(player)
	return player
