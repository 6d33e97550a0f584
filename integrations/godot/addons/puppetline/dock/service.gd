@tool
extends RefCounted
## The dock's model of a service: its state, requested every second, and the requests of the dock. It has no controls.

## Emitted when [member connection], [member characters] or [member chosen] has changed.
signal changed
## Emitted when [member mapping] has changed, or when an edit has been refused.
signal mapping_changed
## Emitted with an error text when a request has failed.
signal refused(text: String)
## Emitted when a request has succeeded.
signal done

const Stream := preload("../wire/stream.gd")
const Requests := preload("../wire/control.gd")
const Message := preload("../wire/message.gd")
const Checked := preload("checked.gd")
const CharacterStatus := preload("character_status.gd")
const Mapping := preload("mapping.gd")
const Activity := preload("activity.gd")

## Time between two requests of the service's state, in milliseconds.
const REQUEST_INTERVAL_MS := 1000

var host := ""
var port := 0
var token := ""
## State of the connection, as a sentence.
var connection := ""
var characters: Array[CharacterStatus] = []
## The chosen character; null if there is none.
var chosen: CharacterStatus
## Mapping of the chosen character; null before it has arrived.
var mapping: Mapping
var activity := Activity.new()

var _stream: Stream
var _requests: Requests
var _next_request_ms := 0
var _missing_replies := 0
var _wanted_character := ""  # the character to choose as soon as it exists
var _followed := ""
var _edits: Array[Dictionary] = []  # edits that have not been sent
var _editing := false
var _edited := 0


## Follow a service instead of the previous one. If [param control_port] is 0, it is the port after [param to_port].
func open(to_host: String, to_port: int, with_token: String, control_port := 0) -> void:
	close()
	host = to_host
	port = to_port
	token = with_token
	_stream = Stream.shared(host, port, token)
	_stream.retry()
	_stream.state_changed.connect(_take_state)
	_requests = Requests.new(host, control_port if control_port > 0 else port + 1, token)
	_take_state(_stream.state)


## Disconnect from the service; the choice of the character is kept.
func close() -> void:
	if _stream == null:
		return
	_follow("")
	_stream.state_changed.disconnect(_take_state)
	_stream = null
	connection = "Not connected."
	_reset()
	_requests = null
	changed.emit()


func is_open() -> bool:
	return _stream != null


func is_online() -> bool:
	return _stream != null and _stream.state == Stream.State.CONNECTED


## Exchange messages with the service as far as that is possible without waiting.
func poll() -> void:
	if _stream == null:
		return
	_stream.poll()
	_requests.poll()
	if is_online() and _missing_replies == 0 and Time.get_ticks_msec() >= _next_request_ms:
		_request_state()


## Choose a character.
func choose(character: String) -> void:
	_wanted_character = character
	_choose()
	_next_request_ms = 0


func calibrate() -> void:
	_request({"do": "calibrate"})


func set_mirror(on: bool) -> void:
	_request({"do": "mirror", "on": on})


## Let a performer drive the character; [constant CharacterStatus.NO_USER] lets the service choose the performer.
func choose_user(user: int) -> void:
	var asked: Variant = null if user == CharacterStatus.NO_USER else user
	_request({"do": "choose_user", "user": asked})


## Start or finish a take of the character's stage.
func set_recording(on: bool) -> void:
	if chosen != null:
		_requests.request({"do": "record_start" if on else "record_stop", "stage": chosen.stage}, _take_answer)


## Change values of a handle: its joint or joints, axes or gain.
func set_handle(handle: String, changes: Dictionary) -> void:
	if mapping != null:
		_edit_puppet(mapping.edit_handle(handle, changes))


## Set the root joint and its axes; an empty joint removes the root motion.
func set_root(joint: String, axes: String) -> void:
	if mapping != null:
		_edit_puppet(mapping.edit_root(joint, axes))


## Set the metres that the character moves per metre of the performer; 0 for the automatic scale.
func set_scale(scale: float) -> void:
	if mapping != null:
		_edit_puppet(mapping.edit_scale(scale))


func save() -> void:
	_edit({"do": "save_puppet"})


func revert() -> void:
	_edit({"do": "revert_puppet"})


func _take_state(state: Stream.State) -> void:
	match state:
		Stream.State.CONNECTED:
			connection = "Connected to %s:%d." % [host, port]
			_next_request_ms = 0
		Stream.State.REFUSED:
			connection = _stream.reason
			_reset()
		Stream.State.CONNECTING:
			connection = "Connecting to %s:%d …" % [host, port]
		Stream.State.OFFLINE:
			connection = "%s Retrying." % _stream.reason if _stream.reason else "Not connected."
			_reset()
	changed.emit()


## Cancel all requests and edits, because later replies come from another service or run.
func _reset() -> void:
	_requests.close()
	characters.clear()
	_missing_replies = 0
	_edits.clear()
	_editing = false
	_choose()


func _request_state() -> void:
	_next_request_ms = Time.get_ticks_msec() + REQUEST_INTERVAL_MS
	_missing_replies = 1
	_requests.request({"do": "describe"}, _take_characters)
	if chosen != null:
		_missing_replies = 2
		_requests.request({"do": "puppet", "character": chosen.name}, _take_mapping.bind(_edited))


func _take_characters(reply: Dictionary) -> void:
	_missing_replies -= 1
	if reply.ok:
		connection = "Connected to %s:%d." % [host, port]
		_read_characters(reply.get("result"))
		_choose()
	else:
		connection = "Connected to the stream, but not to the control socket. %s" % _error_text(reply)
	changed.emit()


func _read_characters(result: Variant) -> void:
	characters.clear()
	for each in Checked.tables(result, "characters", Checked.MAX_ITEMS):
		characters.append(CharacterStatus.new(each, Checked.table(result, "status")))


## Choose the wanted character if it exists, otherwise the first one.
func _choose() -> void:
	var before := chosen.name if chosen != null else ""
	chosen = characters[0] if characters else null
	for each in characters:
		if each.name == _wanted_character:
			chosen = each
	var now := chosen.name if chosen != null else ""
	if now != before:
		_edits.clear()
		mapping = null
		_next_request_ms = 0
		_follow(now)
		mapping_changed.emit()


func _follow(character: String) -> void:
	if _followed:
		_stream.unfollow(_followed, activity.take)
	_followed = character + "/handles" if character else ""
	activity = Activity.new()
	if _followed:
		_stream.follow(_followed, activity.take)


func _take_mapping(reply: Dictionary, edited: int) -> void:
	_missing_replies -= 1
	# A reply from before the last edit is outdated.
	if reply.ok and edited == _edited:
		_set_mapping(reply)


func _set_mapping(reply: Dictionary) -> void:
	var reported := Mapping.new(reply.get("result"))
	if chosen != null and reported.character == chosen.name:
		mapping = reported
		mapping_changed.emit()


func _request(body: Dictionary) -> void:
	if chosen != null:
		_requests.request(body.merged({"character": chosen.name}), _take_answer)


func _take_answer(reply: Dictionary) -> void:
	if reply.ok:
		done.emit()
	else:
		refused.emit(_error_text(reply))
	_next_request_ms = 0
	changed.emit()


func _edit_puppet(tables: Dictionary) -> void:
	_edit({"do": "set_puppet", "puppet": tables})


## Queue a request until the previous one has been answered. Edits of the puppet that are queued last become one.
func _edit(body: Dictionary) -> void:
	if chosen == null:
		return
	body["character"] = chosen.name
	_edited += 1
	var last: Dictionary = _edits.back() if _edits else {}
	if last.get("do") == body["do"]:
		body["puppet"] = last.get("puppet", {}).merged(body.get("puppet", {}), true)
		_edits.pop_back()
	_edits.append(body)
	_send_edit()


func _send_edit() -> void:
	if _edits and not _editing:
		_editing = true
		var body: Dictionary = _edits.pop_front()
		if "puppet" in body:
			body["puppet"] = JSON.stringify(body["puppet"], "", true, true)
		_requests.request(body, _take_edit)


func _take_edit(reply: Dictionary) -> void:
	_editing = false
	if not reply.ok:
		_edits.clear()
		refused.emit(_error_text(reply))
		mapping_changed.emit()
	elif _edits.is_empty():
		_set_mapping(reply)
		done.emit()
	_next_request_ms = 0
	_send_edit()


## Return the error of a reply as a sentence.
func _error_text(reply: Dictionary) -> String:
	var error: Variant = reply.get("error")
	var parts: Array = []
	for key: String in ["where", "found", "expected", "fix"]:
		parts.append(Checked.text(error, key))
	return "%s: found %s; expected %s. %s" % parts
