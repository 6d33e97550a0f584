@tool
extends RefCounted
## A service as the dock sees it: what it says each second, and what is asked of it. There are no controls in here.

## Something is to be shown anew: [member connection], [member roles] or [member chosen].
signal changed
## The mapping of the chosen character has come, or another one, or an edit of it was refused.
signal mapping_changed
## What was asked for cannot be done; a text for people.
signal refused(text: String)
## What was asked for has been done.
signal done

const Stream := preload("../wire/stream.gd")
const Requests := preload("../wire/control.gd")
const Message := preload("../wire/message.gd")
const Checked := preload("checked.gd")
const Role := preload("role.gd")
const Mapping := preload("mapping.gd")
const Activity := preload("activity.gd")

## Milliseconds from one look at the service to the next.
const INTERVAL := 1000

var host := ""
var port := 0
var token := ""
## How the connection is, in a sentence.
var connection := ""
var roles: Array[Role] = []
## The character that is dealt with; null where there is none.
var chosen: Role
## Of the chosen character; null before it has come.
var mapping: Mapping
var activity := Activity.new()

var _stream: Stream
var _requests: Requests
var _look_at := 0
var _looking := 0  # replies that are missing
var _wish := ""  # the character that is chosen as soon as it is there
var _followed := ""
var _edits: Array[Dictionary] = []  # that have not been sent
var _editing := false
var _edited := 0


## Follow a service, in place of the one before. [param control_port] is the one after [param to_port] if it is 0.
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


## Let go of the service; what was chosen is remembered.
func close() -> void:
	if _stream == null:
		return
	_follow("")
	_stream.state_changed.disconnect(_take_state)
	_stream = null
	connection = "Not connected."
	_forget()
	_requests = null
	changed.emit()


func is_open() -> bool:
	return _stream != null


func is_online() -> bool:
	return _stream != null and _stream.state == Stream.State.CONNECTED


## Do what there is to do now.
func poll() -> void:
	if _stream == null:
		return
	_stream.poll()
	_requests.poll()
	if is_online() and _looking == 0 and Time.get_ticks_msec() >= _look_at:
		_look()


## Deal with this character from now on.
func choose(character: String) -> void:
	_wish = character
	_choose()
	_look_at = 0


func calibrate() -> void:
	_ask({"do": "calibrate"})


func set_mirror(on: bool) -> void:
	_ask({"do": "mirror", "on": on})


## Have a performer play the character; [constant Role.NOBODY] lets the service choose.
func choose_user(user: int) -> void:
	var asked: Variant = null if user == Role.NOBODY else user
	_ask({"do": "choose_user", "user": asked})


## Begin or end a take of the stage that the character is on.
func set_recording(on: bool) -> void:
	if chosen != null:
		_requests.request({"do": "record_start" if on else "record_stop", "stage": chosen.stage}, _take_answer)


## Change joints (a text with spaces, or null), axes or gain of a handle.
func set_handle(handle: String, changes: Dictionary) -> void:
	_edit(changes.merged({"do": "set_handle", "handle": handle}))


## Have a joint carry the character along these axes; none if it is empty.
func set_root(joint: String, axes: String) -> void:
	var asked: Variant = null if joint.is_empty() else joint
	_edit({"do": "set_root", "joint": asked, "axes": axes})


## Set the character's metres for one of the performer's; 0 has them found out.
func set_scale(scale: float) -> void:
	var asked: Variant = "auto" if scale <= 0.0 else scale
	_edit({"do": "set_scale", "scale": asked})


func save() -> void:
	_edit({"do": "save_puppet"})


func revert() -> void:
	_edit({"do": "revert_puppet"})


func _take_state(state: Stream.State) -> void:
	match state:
		Stream.State.CONNECTED:
			connection = "Connected with %s:%d." % [host, port]
			_look_at = 0
		Stream.State.REFUSED:
			connection = _stream.reason
			_forget()
		Stream.State.CONNECTING:
			connection = "Looking for %s:%d …" % [host, port]
		Stream.State.OFFLINE:
			connection = "%s It is tried again and again." % _stream.reason if _stream.reason else "Not connected."
			_forget()
	changed.emit()


## What has been asked for is given up: whoever answers later is another service.
func _forget() -> void:
	_requests.close()
	roles.clear()
	_looking = 0
	_edits.clear()
	_editing = false
	_choose()


func _look() -> void:
	_look_at = Time.get_ticks_msec() + INTERVAL
	_looking = 1
	_requests.request({"do": "describe"}, _take_roles)
	if chosen != null:
		_looking = 2
		_requests.request({"do": "puppet", "character": chosen.character}, _take_mapping.bind(_edited))


func _take_roles(reply: Dictionary) -> void:
	_looking -= 1
	if reply.ok:
		connection = "Connected with %s:%d." % [host, port]
		_read_roles(reply.get("result"))
		_choose()
	else:
		connection = "Its stream is there, but nothing can be asked. %s" % _told(reply)
	changed.emit()


func _read_roles(result: Variant) -> void:
	roles.clear()
	for each in Checked.tables(result, "characters", Checked.MOST):
		roles.append(Role.new(each, Checked.table(result, "status")))


## Find the character that is wished for among those who are there, the first one failing that.
func _choose() -> void:
	var before := chosen.character if chosen != null else ""
	chosen = roles[0] if roles else null
	for each in roles:
		if each.character == _wish:
			chosen = each
	var now := chosen.character if chosen != null else ""
	if now != before:
		_edits.clear()
		mapping = null
		_look_at = 0
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
	_looking -= 1
	# What was said before the last edit is out of date.
	if reply.ok and edited == _edited:
		_set_mapping(reply)


func _set_mapping(reply: Dictionary) -> void:
	var said := Mapping.new(reply.get("result"))
	if chosen != null and said.character == chosen.character:
		mapping = said
		mapping_changed.emit()


func _ask(body: Dictionary) -> void:
	if chosen != null:
		_requests.request(body.merged({"character": chosen.character}), _take_answer)


func _take_answer(reply: Dictionary) -> void:
	if reply.ok:
		done.emit()
	else:
		refused.emit(_told(reply))
	_look_at = 0
	changed.emit()


## Change the mapping when the edits before have been answered; of two of the same thing, the later one counts.
func _edit(body: Dictionary) -> void:
	if chosen == null:
		return
	body["character"] = chosen.character
	_edited += 1
	var last: Dictionary = _edits.back() if _edits else {}
	if last.get("do") == body["do"] and last.get("handle") == body.get("handle"):
		last.merge(body, true)
	else:
		_edits.append(body)
	_send_edit()


func _send_edit() -> void:
	if _edits and not _editing:
		_editing = true
		_requests.request(_edits.pop_front(), _take_edit)


func _take_edit(reply: Dictionary) -> void:
	_editing = false
	if not reply.ok:
		_edits.clear()
		refused.emit(_told(reply))
		mapping_changed.emit()
	elif _edits.is_empty():
		_set_mapping(reply)
		done.emit()
	_look_at = 0
	_send_edit()


## Put an error into a sentence.
func _told(reply: Dictionary) -> String:
	var error: Variant = reply.get("error")
	var parts: Array = []
	for key: String in ["where", "found", "expected", "fix"]:
		parts.append(Checked.text(error, key))
	return "%s: found %s; expected %s. %s" % parts
