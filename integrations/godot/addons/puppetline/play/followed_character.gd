extends RefCounted
## The character that a [Puppet3D] shows, and what a service says of it: its scene, its performer, takes and frames.

## Emitted when another character is followed, and when the scene has arrived or changed.
signal changed
## Emitted when the character is not followed any more.
signal left
## Emitted when [member is_other_version] has changed to true.
signal other_version_noticed
## Emitted with each frame of the service, as it arrives.
signal frame_received(frame: Message)
## Emitted with each status of the service: the timeline of the takes that play, empty without any.
signal timeline_received(timeline: Dictionary)

const Stream := preload("../wire/stream.gd")
const ServiceLink := preload("../wire/service_link.gd")
const Performer := preload("../wire/performer.gd")
const Takes := preload("../wire/takes.gd")
const Message := preload("../wire/message.gd")
const Scene := preload("../wire/scene.gd")
const SharedScene := preload("shared_scene.gd")
const ReceivedFrames := preload("received_frames.gd")
const Body := preload("body.gd")

## Name of the character; empty before it is known.
var name := ""
## The connection to the service; null before it is needed.
var link: ServiceLink
## Its scene and resources; null before the character is known.
var shared: SharedScene
## The scene; null before it has arrived.
var scene: Scene:
	get:
		return shared.scene if shared != null else null
var performer := Performer.new()
var takes := Takes.new()
var frames := ReceivedFrames.new()
## Whether the character is that of clips, and the service sends only its frames.
var is_of_clips := false
## Whether the service's version of the character differs from that of the clips.
var is_other_version := false
## Whether the service's mesh is shown, which is then made in advance.
var shows_mesh := false

var _wanted := ""  # name of the character; empty for the first one of the service
var _topic := ""  # of its frames
var _frame_size := 0
var _is_ready := false  # whether frames of the scene can be shown


## Use a connection from now on.
func connect_by(to: ServiceLink) -> void:
	link = to
	link.characters_changed.connect(_on_characters)
	link.status_received.connect(_on_status)


## Return the stream; null until the address of the service is known.
func stream() -> Stream:
	return link.stream if link != null else null


func is_connected_to_service() -> bool:
	return link != null and link.state == Stream.State.CONNECTED


## Follow the character as soon as the address of the service is known; return false before. Without a name, the first
## one of the service is followed when it is known.
func join(wanted: String, body: Body) -> bool:
	_wanted = wanted
	if not link.join():
		return false
	if is_of_clips:
		link.stream.follow(name + "/performer", _on_performer)
		follow_frames(body)
	elif wanted:
		follow(wanted)
	return true


## Follow a character of the service.
func follow(which: String) -> void:
	if which == name:
		return
	_unfollow()
	name = which
	shared = SharedScene.shared(link.stream, name)
	shared.shows_mesh = shared.shows_mesh or shows_mesh
	shared.changed.connect(_on_scene)
	link.stream.follow(name + "/performer", _on_performer)
	changed.emit()


## Show the character of clips.
func show_clips(which: String, of: SharedScene) -> void:
	name = which
	shared = of


## Follow the frames that a body needs, unless they are followed or the service is not known.
func follow_frames(body: Body) -> void:
	if body == null:
		return
	_is_ready = true
	_frame_size = body.frame_size()
	if _topic.is_empty() and stream() != null:
		_topic = "%s/%s" % [name, body.payload_name()]
		stream().follow(_topic, _on_frame)


## Follow no frames until a body for the present scene has been made.
func unfollow_frames() -> void:
	if _topic:
		link.stream.unfollow(_topic, _on_frame)
	_topic = ""
	_is_ready = false
	frames.clear()


## Take notice of what the stream has received.
func notice() -> void:
	if link != null:
		link.notice_state()
	if link != null and shared != null and not is_of_clips:
		shared.poll()


## Disconnect from the service and follow nothing.
func leave() -> void:
	is_other_version = false
	_unfollow()
	var old := link
	link = null
	if old != null:
		old.close()


## Return what prevents that the character is shown, as sentences for the user.
func problems(wanted: String) -> PackedStringArray:
	var found := PackedStringArray()
	var names: Array[String] = []
	if link != null:
		names = link.characters
	if link != null and link.state == Stream.State.REFUSED:
		found.append("The service refuses the connection: %s" % link.stream.reason)
	if wanted and not names.is_empty() and wanted not in names:
		found.append("The service has no character '%s'. Its characters are: %s." % [wanted, ", ".join(names)])
	if is_other_version:
		found.append(
			"The service's version of %s differs from the clip's, and is not shown. Write the clip again." % name
		)
	return found


## Return the state of the connection and of the frames, see [method Puppet3D.statistics].
func statistics() -> Dictionary:
	return {
		"character": name,
		"connected": is_connected_to_service(),
		"user": performer.user,
		"calibrated": performer.is_calibrated,
		"frames_per_second": frames.per_second(),
		"latency": stream().same_machine_latency() if stream() != null else -1.0,
		"waiting": frames.playback.waiting(),
		"lost": frames.playback.lost,
		"damaged": frames.damaged,
	}


func _unfollow() -> void:
	if shared == null:
		return
	if stream() != null:
		stream().unfollow(name + "/performer", _on_performer)
	if shared.changed.is_connected(_on_scene):
		shared.changed.disconnect(_on_scene)
	unfollow_frames()
	shared = null
	name = ""
	left.emit()


func _on_characters() -> void:
	var names := link.characters
	if not is_of_clips and _wanted.is_empty() and not names.is_empty() and name not in names:
		follow(names[0])


func _on_performer(message: Message) -> void:
	performer.notice(message.user, message.state)


func _on_status(status: Dictionary) -> void:
	takes.notice(status, name)
	var timeline: Variant = status.get("timeline")
	timeline_received.emit(timeline if timeline is Dictionary else {})


func _on_scene() -> void:
	_is_ready = false
	changed.emit()


func _on_frame(message: Message) -> void:
	if not _is_ready:
		return
	if message.revision != scene.revision:
		_notice_other_version()
	elif frames.push(message, _frame_size):
		frame_received.emit(message)


## Request the scene again. The scene of clips never changes.
func _notice_other_version() -> void:
	if not is_of_clips:
		shared.ask()
	elif not is_other_version:
		is_other_version = true
		other_version_noticed.emit()
