@tool
@icon("icons/puppet_3d.svg")
class_name Puppet3D
extends "play/rendered_node.gd"
## Shows a character of `puppetline serve`, driven live by a performer.
##
## Add the node to a scene and start the service. The character appears with its mesh, in the editor too. The node
## connects and reconnects automatically. The shown meshes are not saved with your scene.

## Emitted when the service is connected.
signal connected
## Emitted when the service is disconnected. The node keeps retrying.
signal disconnected
## Emitted when the service refuses the connection. The node does not retry until [method retry] is called, or [member
## token] or the address changes.
signal refused(reason: String)
## Emitted when the character has arrived or changed, after its new meshes have been made.
signal scene_loaded
## Emitted when a new pose has been set, once per image. Nodes that follow the surface move then.
signal pose_updated
## Emitted with each frame of the service, as it arrives.
signal frame_received(frame: Message)
## Emitted when a performer has been found for the character. The performer should stand still for one second.
signal performer_found(user: int)
## Emitted when the performer has been calibrated and drives the character.
signal performer_calibrated(user: int)
## Emitted when the performer has left.
signal performer_lost(user: int)
## Emitted when the service has started to record a take of the character's stage.
signal take_started(take: String)
## Emitted when the service has finished a take.
signal take_stopped(take: String)
## Emitted with each status of the service: the timeline of the takes that play (docs/control.md), empty without any.
signal timeline_received(timeline: Dictionary)

## How the service sends the character.
enum Mode {
	## About 80 transforms per frame, blended on the graphics card. This is the best mode for almost all characters.
	CONTROLS,
	## All vertices in each frame, without interpolation. Use it for characters that exceed the limits of CONTROLS.
	VERTICES,
	## Weights of the morph targets of [member mesh_source].
	MORPHS,
}

## The clock that moves the character.
enum Clock {
	## The time of the machine: the character follows its performer as closely as possible.
	REALTIME,
	## The time of the engine: it stops while the game is paused, and `Engine.time_scale` and the movie writer change
	## it.
	ENGINE,
	## Calls of [method advance].
	MANUAL,
}

const Stream := preload("wire/stream.gd")
const ServiceLink := preload("wire/service_link.gd")
const Performer := preload("wire/performer.gd")
const Takes := preload("wire/takes.gd")
const Connections := preload("wire/connections.gd")
const Message := preload("wire/message.gd")
const Scene := preload("wire/scene.gd")
const SharedScene := preload("play/shared_scene.gd")
const Playback := preload("play/playback.gd")
const ReceivedFrames := preload("play/received_frames.gd")
const MixedPlayback := preload("play/mixed_playback.gd")
const ClipPlayer := preload("play/clip_player.gd")
const ClipAnimations := preload("play/clip_animations.gd")
const Display := preload("play/display.gd")
const Body := preload("play/body.gd")
const ControlsBody := preload("play/controls_body.gd")
const VerticesBody := preload("play/vertices_body.gd")
const MorphsBody := preload("play/morphs_body.gd")
const RestMesh := preload("play/rest_mesh.gd")
const SurfacePatch := preload("play/surface_patch.gd")

@export_group("Service")
## Host name or address of the service. If empty, the first service found on the network that has the [member
## character]. One that requires a token is used only with [member trust_network].
@export var host := "127.0.0.1":
	set(value):
		_link_stale = _link_stale or value != host
		host = value
## Port of the stream; the control socket uses the next port.
@export_range(1, 65534) var port := 7400:
	set(value):
		_link_stale = _link_stale or value != port
		port = value
## The service's token, if it requires one. It is saved with the scene in plain text.
@export var token := "":
	set(value):
		_link_stale = _link_stale or value != token
		token = value
## Whether the [member token] is sent to a service that was found on the network because [member host] is empty. Any
## program on the network can announce itself as a service, and then receives the token.
@export var trust_network := false:
	set(value):
		_link_stale = _link_stale or value != trust_network
		trust_network = value

@export_group("Character")
## Name of the character. If empty, the first one of the service.
@export var character := "":
	set(value):
		_link_stale = _link_stale or value != character
		character = value
## Show the character only while the performer with this user number drives it; −1 for always.
@export var user_slot := -1:
	set(value):
		user_slot = value
		_display.reset_preview()
		_performer.slot = value
## How the service sends the character.
@export var mode := Mode.CONTROLS:
	set(value):
		_body_stale = _body_stale or value != mode
		mode = value
## Your own .glb of the character, with its materials and textures: for CONTROLS one from `puppetline shader-mesh`, for
## MORPHS one from `puppetline bake`. If empty, the mesh that the service sends.
@export var mesh_source: PackedScene:
	set(value):
		_body_stale = _body_stale or value != mesh_source
		mesh_source = value
		_display.reset_preview()
## Materials that replace the character's own, by surface. A surface without one keeps its own. Standard materials are
## copied. A shader material must call the function described in `addons/puppetline/play/puppet.gdshaderinc`.
@export var materials: Array[Material] = []:
	set(value):
		materials = value
		if _display.body != null:
			_display.body.set_materials(materials)
## Whether the character walks with its performer, or stays in place.
@export var follow_root := true:
	set(value):
		_body_stale = _body_stale or value != follow_root
		follow_root = value

@export_group("Clip")
## A clip that the node plays instead of a service's stream.
@export var clip: PuppetClip:
	set(value):
		_clips_stale = _clips_stale or value != clip
		clip = value
## Shown position of the [member clip], in seconds. An AnimationPlayer can animate it, with a [member clip_speed] of 0.
@export_range(0.0, 600.0, 0.001, "or_greater", "suffix:s") var clip_position := 0.0
## Speed at which the [member clip] plays automatically. Pauses of the game and `Engine.time_scale` apply; with the
## clock MANUAL, [method advance] moves it.
@export var clip_speed := 1.0
## Whether the [member clip] begins again after its end.
@export var clip_loops := true
## Clips of one character that an AnimationPlayer or an AnimationTree mixes, by the animations of [method
## make_clip_animations]. If their weights add up to less than 1, [member clip] has the rest.
@export var mixed_clips: Array[PuppetClip] = []:
	set(value):
		_clips_stale = true
		mixed_clips = value
		_clips.resize(value.size())
## Weight of the performer against the clips: 0 shows the clips, 1 the performer. The node connects to the service when
## the weight is first greater than 0, and shows the clips until a frame arrives.
@export_range(0.0, 1.0, 0.001) var live_weight := 0.0

@export_group("Playing")
## The clock that moves the character. With a clock that is slower than the performer, frames wait, and none is skipped.
@export var clock := Clock.REALTIME:
	set(value):
		if clock != value:
			clock = value
			_frames.set_clock(clock == Clock.REALTIME)
			_frames.delay = _delay()
## Delay of the character in seconds, so that each image lies between two frames. Higher values are smoother on a bad
## network; lower values react faster.
@export_range(0.0, 1.0, 0.005, "suffix:s") var interpolation_delay := 0.05:
	set(value):
		interpolation_delay = value
		_frames.delay = _delay()
## Whether the character is shown in the editor too.
@export var preview_in_editor := true

var _link: ServiceLink
var _performer := Performer.new()
var _takes := Takes.new()
var _shared: SharedScene
var _frames := ReceivedFrames.new()
var _clips := ClipPlayer.new()
var _shown := MixedPlayback.new()
var _display := Display.new(self)
var _name := ""  # name of the followed character
var _topic := ""  # topic of its frames
var _link_stale := false
var _clips_stale := false
var _is_other_version := false  # whether the service's character differs from that of the clips
var _body_stale := false


func _init() -> void:
	_frames.delay = _delay()
	_performer.found.connect(performer_found.emit)
	_performer.calibrated.connect(performer_calibrated.emit)
	_performer.lost.connect(performer_lost.emit)
	_takes.started.connect(take_started.emit)
	_takes.stopped.connect(take_stopped.emit)


func _process(delta: float) -> void:
	var plays := preview_in_editor or not Engine.is_editor_hint()
	if _clips_stale and _has_loaded_clips():
		_take_clips()
	if _link_stale or not plays:
		_leave()
	_move_clip(delta if clock != Clock.MANUAL else 0.0)
	if clock == Clock.ENGINE:
		_frames.advance_clock(delta, Engine.time_scale == 1.0 and not OS.has_feature("movie"))
	if plays:
		_play()
	else:
		_display.reset_preview()


func _exit_tree() -> void:
	_leave()


func _get_configuration_warnings() -> PackedStringArray:
	var warnings := PackedStringArray()
	if _clips.problem:
		warnings.append(_clips.problem)
	elif mode == Mode.MORPHS and mesh_source == null:
		warnings.append("The mode MORPHS requires a mesh_source. Import the .glb from `puppetline bake` and assign it.")
	if token and _sent_token().is_empty():
		warnings.append("The token is not sent to services found on the network. Set host, or turn on trust_network.")
	if _link != null and _link.state == Stream.State.REFUSED:
		warnings.append("The service refuses the connection: %s" % _link.stream.reason)
	var names: Array[String] = []
	if _link != null:
		names = _link.characters
	if character and not names.is_empty() and character not in names:
		warnings.append("The service has no character '%s'. Its characters are: %s." % [character, ", ".join(names)])
	if _is_other_version:
		warnings.append(
			"The service's version of %s differs from the clip's, and is not shown. Write the clip again." % _name
		)
	if _display.body != null and _display.body.problem:
		warnings.append("%s: %s." % [_name, _display.body.problem])
	return warnings


## Send a request to the service (docs/control.md). [param done] is called with its reply, or with an error of the same
## form if there is no reply.
func request(body: Dictionary, done := Callable()) -> void:
	_made_link().request(body, done if done.is_valid() else _warn_of_failure)


## Connect again immediately, even if the service has refused the connection.
func retry() -> void:
	if _stream() != null:
		_stream().retry()


## Move the character on by a time in seconds, with the clock MANUAL. The next frames are shown immediately.
func advance(seconds: float) -> void:
	if clock != Clock.MANUAL:
		push_warning("Puppetline: advance() has no effect. Set clock to MANUAL first.")
		return
	if _clips_stale:
		_take_clips()
	_move_clip(seconds)
	_frames.advance_clock(seconds, false)
	_show_next()


## Read what the service has sent and show it, within an image: to prepare what the first image of a movie shows.
func refresh() -> void:
	if _stream() != null:
		_stream().read()
	_process(0.0)


## Return an animation per clip of [member mixed_clips], and RESET, for an AnimationPlayer whose root node is this node.
## An AnimationTree blends them. An AnimationPlayer does so if its `deterministic` is on.
func make_clip_animations() -> AnimationLibrary:
	return ClipAnimations.library(mixed_clips)


## Calibrate again: map the performer's current pose to the character's rest pose.
func calibrate() -> void:
	request({"do": "calibrate", "character": _name})


## Let the performer's left side move the character's right side (true) or its left side (false).
func set_mirror(on: bool) -> void:
	request({"do": "mirror", "character": _name, "on": on})


## Record a take of the character's stage after [param count_in] seconds. Without a name, the service chooses one.
## [param done] is called as described at [method request].
func start_recording(take := "", done := Callable(), count_in := 0) -> void:
	var body := {"do": "record_start", "count_in": count_in}
	if take:
		body["name"] = take
	_made_link().request_of_stage(body, _name, done if done.is_valid() else _warn_of_failure)


## Finish the take that is being recorded.
func stop_recording(done := Callable()) -> void:
	_made_link().request_of_stage({"do": "record_stop"}, _name, done if done.is_valid() else _warn_of_failure)


## Compute the positions of all vertices as they are shown, in the coordinates of this node. This is slow and intended
## for tools. The order is that of the scene; in the mode MORPHS, that of the imported meshes.
func evaluate() -> PackedVector3Array:
	return _display.body.evaluate() if _display.body != null else PackedVector3Array()


## Return the scene of the character: its mesh, handles and limbs at rest. It is null before [signal scene_loaded].
func get_character_scene() -> Scene:
	return _shared.scene if _shared != null else null


## Return the pose of a point of the shown surface, in the coordinates of this node: the origin is the vertex of the
## scene, the y axis points out of the surface, and the z axis to the front of the character at rest. Only the vertices
## around it are evaluated. Before the first frame, it is the identity.
func get_surface_transform(vertex: int) -> Transform3D:
	var scene := get_character_scene()
	if scene == null or vertex < 0 or vertex >= scene.vertex_count:
		return Transform3D.IDENTITY
	return get_patch_transform(_display.patch_at(scene, vertex), Transform3D.IDENTITY)


## Return the shown pose of a patch of the surface, with an orthonormal basis in the space that [param to_space]
## transforms to. Before the first frame, it is the pose of this node.
func get_patch_transform(patch: SurfacePatch, to_space: Transform3D) -> Transform3D:
	return _display.patch_pose(patch, _shown, to_space)


## Return where a segment hits the shown surface first: `position` and `normal` in global coordinates, and the number of
## the nearest `vertex` in the scene (−1 in the mode MORPHS). It is empty if nothing is hit. Modes other than CONTROLS
## are slow.
func intersect_ray(from: Vector3, to: Vector3) -> Dictionary:
	return _display.intersect(from, to)


## Return boxes that cover the character at rest, and the transforms that move them now, in the coordinates of this
## node. Both are empty before the first frame, and in modes other than CONTROLS.
func get_piece_boxes() -> Array[AABB]:
	if _display.body == null:
		return []
	return _display.body.piece_boxes()


func get_piece_transforms() -> Array[Transform3D]:
	if _display.body == null:
		return []
	return _display.body.piece_transforms()


## Return the state of the node: `character`, `connected`, `user`, `calibrated`, `frames_per_second`, `latency`
## (seconds, see `same_machine_latency` in wire/stream.gd), `waiting` (frames not shown yet), `lost` (frames lost in
## transmission), `damaged` (frames of the wrong size), and the shown position in the motion: `sequence`,
## `next_sequence`, `share`.
func statistics() -> Dictionary:
	return {
		"character": _name,
		"connected": _is_connected(),
		"user": _performer.user,
		"calibrated": _performer.is_calibrated,
		"frames_per_second": _frames.per_second(),
		"latency": _stream().same_machine_latency() if _stream() != null else -1.0,
		"waiting": _frames.playback.waiting(),
		"lost": _frames.playback.lost,
		"damaged": _frames.damaged,
		"sequence": _shown.earlier.sequence if _shown.earlier != null else -1,
		"next_sequence": _shown.later.sequence if _shown.later != null else -1,
		"share": _shown.share,
	}


## The properties that animations of clips set: `mix/0` and so on.
func _set(property: StringName, value: Variant) -> bool:
	var number := _mix_number(property)
	if number >= 0 and value is Vector2:
		_clips.mix[number] = value
	return number >= 0


func _get(property: StringName) -> Variant:
	var number := _mix_number(property)
	return _clips.mix[number] if number >= 0 else null


## Return the number of the mixed clip to which a property belongs; −1 for other properties.
func _mix_number(property: StringName) -> int:
	if not property.begins_with(ClipAnimations.PROPERTY_PREFIX):
		return -1
	var number := property.trim_prefix(ClipAnimations.PROPERTY_PREFIX).to_int()
	return number if number < _clips.mix.size() else -1


func _play() -> void:
	_display.show_preview(user_slot < 0, _own_character)
	var playable := _clips.first()
	if playable != null:
		_show_clip_scene()
	var waits := _clips_stale and _link == null
	if (not _clips.is_used and not waits) or (playable != null and (live_weight > 0.0 or _link != null)):
		_poll_service()
	if is_inside_tree():
		_show_next()


## Read what the service has sent.
func _poll_service() -> void:
	# A callback may disconnect this node, or remove it from the scene.
	_made_link().poll_control()
	if not is_inside_tree() or not _join():
		return
	_link.stream.poll()
	_receive()
	if clock == Clock.ENGINE and OS.has_feature("movie"):
		_frames.wait_for_movie(_read_stream)


## Return whether threads have loaded the clips that have been set, one after another. Images of the editor, of a movie
## and of the clock MANUAL do not wait for threads.
func _has_loaded_clips() -> bool:
	if Engine.is_editor_hint() or OS.has_feature("movie") or clock == Clock.MANUAL:
		return true
	for each: PuppetClip in [clip] + mixed_clips:
		if each != null and not each.load_in_thread(mesh_source == null):
			return false
	return true


## Begin to show the clips that have been set. The meshes are kept if the clips are of the same scene.
func _take_clips() -> void:
	_clips_stale = false
	var before := _clips.first()
	_clips.set_clips(clip, mixed_clips)
	var now := _clips.first()
	if before == null or now == null or before.shared_scene() != now.shared_scene():
		_link_stale = true
	update_configuration_warnings()


func _show_clip_scene() -> void:
	if _shared == null:
		_shared = _clips.first().shared_scene()
		_name = character if character else _clips.first().character()
		_body_stale = true
	if _body_stale:
		_build()


func _move_clip(seconds: float) -> void:
	if clip == null or clip_speed == 0.0 or _clips_stale:
		return
	var moved := clip_position + clip_speed * seconds
	var length := clip.length()
	clip_position = fposmod(moved, length) if clip_loops and length > 0.0 else clampf(moved, 0.0, length)


## Take notice of what the stream has received.
func _receive() -> void:
	if _link != null:
		_link.notice_state()
	_link_stale = _link_stale or (_link != null and _link.is_lost())
	if _link == null or _shared == null or _clips.is_used:
		return
	_shared.poll()
	if _body_stale and _shared.scene != null:
		_build()


## Read what has arrived; return false if there is no stream.
func _read_stream() -> bool:
	if _stream() == null:
		return false
	_stream().read()
	_receive()
	return true


func _show_next() -> void:
	if _display.body == null:
		return
	var parts: Array[Playback] = []
	var weights := PackedFloat64Array()
	var live := live_weight if _clips.is_used else 1.0
	if live > 0.0 and _frames.advance() and _is_wanted(_frames.playback.earlier.user):
		parts.append(_frames.playback)
		weights.append(live)
	else:
		live = 0.0
	if _clips.is_used and live < 1.0:
		_clips.advance(clip_position)
		for i in _clips.shown.size():
			parts.append(_clips.shown[i])
			weights.append((1.0 - live) * _clips.weights[i])
	_shown.mix(parts, weights)
	if _shown.earlier != null:
		_show()


## Return whether frames with a user number are shown: those that are mixed with clips must be of [member user_slot].
func _is_wanted(user: int) -> bool:
	return not _clips.is_used or user_slot < 0 or user == user_slot


## Return the delay that the clock requires: in real time, frames arrive irregularly.
func _delay() -> float:
	return 0.0 if clock == Clock.MANUAL or OS.has_feature("movie") else interpolation_delay


## Return the connection to the service, which is made on first use.
func _made_link() -> ServiceLink:
	if _link == null:
		_link = ServiceLink.new(name, host, port, _sent_token(), character)
		_link.state_changed.connect(_on_state_changed)
		_link.characters_changed.connect(_on_characters)
		_link.status_received.connect(_on_status)
	return _link


## Follow the character as soon as the address of the service is known; return false before.
func _join() -> bool:
	if not _made_link().join():
		return false
	if _clips.is_used:
		_link.stream.follow(_name + "/performer", _on_performer)
		_follow_frames()
	elif character:
		_follow_character(character)
	return true


## Return the stream; null until the address of the service is known.
func _stream() -> Stream:
	return _link.stream if _link != null else null


func _is_connected() -> bool:
	return _link != null and _link.state == Stream.State.CONNECTED


## Return the token, unless it would be sent to a service that is not trusted.
func _sent_token() -> String:
	return token if host or trust_network else ""


## Disconnect from the service and hide the character.
func _leave() -> void:
	_link_stale = false
	_is_other_version = false
	_unfollow_character()
	var left := _link
	_link = null
	if left != null:
		left.close()


func _follow_character(which: String) -> void:
	if which == _name:
		return
	_unfollow_character()
	_name = which
	_shared = SharedScene.shared(_link.stream, _name)
	_shared.shows_mesh = _shared.shows_mesh or mesh_source == null
	_shared.changed.connect(_on_scene)
	_link.stream.follow(_name + "/performer", _on_performer)
	_body_stale = true


func _unfollow_character() -> void:
	if _shared == null:
		return
	if _stream() != null:
		_stream().unfollow(_name + "/performer", _on_performer)
	if _shared.changed.is_connected(_on_scene):
		_shared.changed.disconnect(_on_scene)
	_unfollow_frames()
	_shared = null
	_name = ""
	_display.clear()


func _unfollow_frames() -> void:
	if _topic:
		_link.stream.unfollow(_topic, _on_frame)
	_topic = ""
	_frames.clear()
	_shown = MixedPlayback.new()


## Make the node that shows the character, and follow the frames that it needs.
func _build() -> void:
	_body_stale = false
	_unfollow_frames()
	var body := _new_body()
	body.follow_root = follow_root
	body.set_materials(materials)
	if body.problem:
		push_warning("Puppetline: %s: %s." % [_name, body.problem])
	_display.set_body(body)
	update_configuration_warnings()
	_follow_frames()
	scene_loaded.emit()


## Follow the frames that the body needs, unless they are followed or the service is not known.
func _follow_frames() -> void:
	if _topic.is_empty() and _stream() != null and _display.body != null:
		_topic = "%s/%s" % [_name, _display.body.payload_name()]
		_stream().follow(_topic, _on_frame)


func _new_body() -> Body:
	var source := _own_character()
	if mode == Mode.MORPHS and not _clips.is_used:
		return MorphsBody.new(_shared.resources, source)
	var uses_controls := mode == Mode.CONTROLS or _clips.is_used
	var obstacle := RestMesh.obstacle(_shared.scene) if uses_controls else ""
	if uses_controls and (obstacle.is_empty() or _clips.is_used):
		var drawn := ControlsBody.new(_shared.resources, source)
		drawn.problem = obstacle if obstacle else drawn.problem
		return drawn
	if source != null:
		source.free()
	if obstacle:
		push_warning("Puppetline: %s falls back to VERTICES: %s." % [_name, obstacle])
	var body := VerticesBody.new(_shared.resources)
	if mesh_source != null:
		body.problem = "the mode VERTICES shows the service's mesh; mesh_source is used by CONTROLS and MORPHS only"
	return body


func _own_character() -> Node3D:
	var own := mesh_source.instantiate() if mesh_source != null else null
	if own != null and not own is Node3D:
		push_warning("Puppetline: %s is not a scene of 3D nodes. Import a .glb." % mesh_source.resource_path)
		own.free()
		return null
	return own


func _show() -> void:
	var is_seen := _clips.is_used or user_slot < 0 or (_is_connected() and _shown.earlier.user == user_slot)
	_display.show_frames(_shown, is_seen)
	pose_updated.emit()


func _shown_nodes() -> Array[Node3D]:
	return _display.nodes()


func _on_state_changed(before: Stream.State) -> void:
	update_configuration_warnings()
	if before == Stream.State.CONNECTED:
		_performer.clear()
		_takes.clear()
		disconnected.emit()
	if _is_connected():
		connected.emit()
	if _link != null and _link.state == Stream.State.REFUSED:
		var address := Connections.address(_link.stream.host, _link.stream.port)
		push_warning("Puppetline: %s refuses the connection: %s" % [address, _link.stream.reason])
		refused.emit(_link.stream.reason)


func _on_characters() -> void:
	update_configuration_warnings()
	var names := _link.characters
	if not _clips.is_used and character.is_empty() and not names.is_empty() and _name not in names:
		_follow_character(names[0])


func _on_performer(message: Message) -> void:
	_performer.notice(message.user, message.state)


func _on_status(status: Dictionary) -> void:
	_takes.notice(status, _name)
	var timeline: Variant = status.get("timeline")
	timeline_received.emit(timeline if timeline is Dictionary else {})


func _on_scene() -> void:
	_body_stale = true


func _on_frame(message: Message) -> void:
	if _body_stale:
		return
	if message.revision != _shared.scene.revision:
		_notice_other_version()
	elif _frames.push(message, _display.body.frame_size()):
		frame_received.emit(message)


## Request the scene again. The scene of clips never changes.
func _notice_other_version() -> void:
	if not _clips.is_used:
		_shared.ask()
	elif not _is_other_version:
		_is_other_version = true
		update_configuration_warnings()


func _warn_of_failure(reply: Dictionary) -> void:
	if not reply.get("ok", false):
		var error: Variant = reply.get("error", {})
		push_warning("Puppetline: %s" % (" ".join(error.values().map(str)) if error is Dictionary else str(error)))
