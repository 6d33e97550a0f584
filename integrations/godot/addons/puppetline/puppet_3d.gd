@tool
@icon("icons/puppet_3d.svg")
class_name Puppet3D
extends "play/clip_node.gd"
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
const Connections := preload("wire/connections.gd")
const Message := preload("wire/message.gd")
const Scene := preload("wire/scene.gd")
const FollowedCharacter := preload("play/followed_character.gd")
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
		_followed.performer.slot = value
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

@export_group("Playing")
## The clock that moves the character. With a clock that is slower than the performer, frames wait, and none is skipped.
@export var clock := Clock.REALTIME:
	set(value):
		if clock != value:
			clock = value
			_followed.frames.set_clock(clock == Clock.REALTIME)
			_followed.frames.delay = _delay()
## Delay of the character in seconds, so that each image lies between two frames. Higher values are smoother on a bad
## network; lower values react faster.
@export_range(0.0, 1.0, 0.005, "suffix:s") var interpolation_delay := 0.05:
	set(value):
		interpolation_delay = value
		_followed.frames.delay = _delay()
## Whether the character is shown in the editor too.
@export var preview_in_editor := true

var _followed := FollowedCharacter.new()
var _display := Display.new(self)
var _link_stale := false
var _body_stale := false


func _init() -> void:
	_followed.frames.delay = _delay()
	_followed.changed.connect(func() -> void: _body_stale = true)
	_followed.left.connect(_on_character_left)
	_followed.other_version_noticed.connect(update_configuration_warnings)
	_followed.frame_received.connect(frame_received.emit)
	_followed.timeline_received.connect(timeline_received.emit)
	_followed.performer.found.connect(performer_found.emit)
	_followed.performer.calibrated.connect(performer_calibrated.emit)
	_followed.performer.lost.connect(performer_lost.emit)
	_followed.takes.started.connect(take_started.emit)
	_followed.takes.stopped.connect(take_stopped.emit)


func _process(delta: float) -> void:
	var plays := preview_in_editor or not Engine.is_editor_hint()
	if _clips_stale and (clock == Clock.MANUAL or _has_loaded_clips(mesh_source == null)):
		_begin_clips()
	if _link_stale or not plays:
		_leave()
	_move_clip(delta if clock != Clock.MANUAL else 0.0)
	if clock == Clock.ENGINE:
		_followed.frames.advance_clock(delta, Engine.time_scale == 1.0 and not OS.has_feature("movie"))
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
	warnings.append_array(_followed.problems(character))
	if _display.body != null and _display.body.problem:
		warnings.append("%s: %s." % [_followed.name, _display.body.problem])
	return warnings


## Send a request to the service (docs/control.md). [param done] is called with its reply, or with an error of the same
## form if there is no reply.
func request(body: Dictionary, done := Callable()) -> void:
	_made_link().request(body, done)


## Connect again immediately, even if the service has refused the connection.
func retry() -> void:
	if _followed.stream() != null:
		_followed.stream().retry()


## Move the character on by a time in seconds, with the clock MANUAL. The next frames are shown immediately.
func advance(seconds: float) -> void:
	if clock != Clock.MANUAL:
		push_warning("Puppetline: advance() has no effect. Set clock to MANUAL first.")
		return
	if _clips_stale:
		_begin_clips()
	_move_clip(seconds)
	_followed.frames.advance_clock(seconds, false)
	_show_next()


## Read what the service has sent and show it, within an image: to prepare what the first image of a movie shows.
func refresh() -> void:
	if _followed.stream() != null:
		_followed.stream().read()
	_process(0.0)


## Calibrate again: map the performer's current pose to the character's rest pose.
func calibrate() -> void:
	request({"do": "calibrate", "character": _followed.name})


## Let the performer's left side move the character's right side (true) or its left side (false).
func set_mirror(on: bool) -> void:
	request({"do": "mirror", "character": _followed.name, "on": on})


## Record a take of the character's stage after [param count_in] seconds. Without a name, the service chooses one.
## [param done] is called as described at [method request].
func start_recording(take := "", done := Callable(), count_in := 0) -> void:
	var body := {"do": "record_start", "count_in": count_in}
	if take:
		body["name"] = take
	_made_link().request_of_stage(body, _followed.name, done)


## Finish the take that is being recorded.
func stop_recording(done := Callable()) -> void:
	_made_link().request_of_stage({"do": "record_stop"}, _followed.name, done)


## Compute the positions of all vertices as they are shown, in the coordinates of this node. This is slow and intended
## for tools. The order is that of the scene; in the mode MORPHS, that of the imported meshes.
func evaluate() -> PackedVector3Array:
	return _display.body.evaluate() if _display.body != null else PackedVector3Array()


## Return the scene of the character: its mesh, handles and limbs at rest. It is null before [signal scene_loaded].
func get_character_scene() -> Scene:
	return _followed.scene


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
	var shown := {
		"sequence": _shown.earlier.sequence if _shown.earlier != null else -1,
		"next_sequence": _shown.later.sequence if _shown.later != null else -1,
		"share": _shown.share,
	}
	return _followed.statistics().merged(shown)


func _play() -> void:
	_display.show_preview(user_slot < 0, OwnMesh.instance_of.bind(mesh_source))
	var playable := _clips.first()
	if playable != null:
		_show_clip_scene()
	var waits := _clips_stale and _followed.link == null
	if (not _clips.is_used and not waits) or (playable != null and (live_weight > 0.0 or _followed.link != null)):
		_poll_service()
	if is_inside_tree():
		_show_next()


## Read what the service has sent.
func _poll_service() -> void:
	# A callback may disconnect this node, or remove it from the scene.
	_followed.shows_mesh = mesh_source == null
	_made_link().poll_control()
	if not is_inside_tree() or not _followed.join(character, _display.body):
		return
	_followed.link.stream.poll()
	_receive()
	if clock == Clock.ENGINE and OS.has_feature("movie"):
		_followed.frames.wait_for_movie(_read_stream)


## Begin to show the clips that have been set. The meshes are kept if the clips are of the same scene.
func _begin_clips() -> void:
	_link_stale = _take_clips() or _link_stale
	_followed.is_of_clips = _clips.is_used
	update_configuration_warnings()


func _show_clip_scene() -> void:
	if _followed.shared == null:
		_followed.show_clips(character if character else _clips.first().character(), _clips.first().shared_scene())
		_body_stale = true
	if _body_stale:
		_build()


## Take notice of what the stream has received.
func _receive() -> void:
	_followed.notice()
	_link_stale = _link_stale or (_followed.link != null and _followed.link.is_lost())
	if _body_stale and not _clips.is_used and _followed.link != null and _followed.scene != null:
		_build()


## Read what has arrived; return false if there is no stream.
func _read_stream() -> bool:
	if _followed.stream() == null:
		return false
	_followed.stream().read()
	_receive()
	return true


func _show_next() -> void:
	if _display.body == null:
		return
	_mix(_followed.frames.playback if _has_wanted_frame() else null)
	if _shown.earlier != null:
		var is_present := _followed.is_connected_to_service() and _shown.earlier.user == user_slot
		_display.show_frames(_shown, _clips.is_used or user_slot < 0 or is_present)
		pose_updated.emit()


## Return whether there is a frame to show. Those that are mixed with clips must be of [member user_slot].
func _has_wanted_frame() -> bool:
	if (_clips.is_used and live_weight <= 0.0) or not _followed.frames.advance():
		return false
	return not _clips.is_used or user_slot < 0 or _followed.frames.playback.earlier.user == user_slot


## Return the delay that the clock requires: in real time, frames arrive irregularly.
func _delay() -> float:
	return 0.0 if clock == Clock.MANUAL or OS.has_feature("movie") else interpolation_delay


## Return the connection to the service, which is made on first use.
func _made_link() -> ServiceLink:
	if _followed.link == null:
		var link := ServiceLink.new(name, host, port, _sent_token(), character)
		link.state_changed.connect(_on_state_changed)
		link.characters_changed.connect(update_configuration_warnings)
		_followed.connect_by(link)
	return _followed.link


## Return the token, unless it would be sent to a service that is not trusted.
func _sent_token() -> String:
	return token if host or trust_network else ""


## Disconnect from the service and hide the character.
func _leave() -> void:
	_link_stale = false
	_followed.leave()


## Make the node that shows the character, and follow the frames that it needs.
func _build() -> void:
	_body_stale = false
	_followed.unfollow_frames()
	_shown = MixedPlayback.new()
	var body := _new_body()
	body.follow_root = follow_root
	body.set_materials(materials)
	if body.problem:
		push_warning("Puppetline: %s: %s." % [_followed.name, body.problem])
	_display.set_body(body)
	update_configuration_warnings()
	_followed.follow_frames(body)
	scene_loaded.emit()


func _new_body() -> Body:
	var source := OwnMesh.instance_of(mesh_source)
	if mode == Mode.MORPHS and not _clips.is_used:
		return MorphsBody.new(_followed.shared.resources, source)
	var uses_controls := mode == Mode.CONTROLS or _clips.is_used
	var obstacle := RestMesh.obstacle(_followed.shared.scene) if uses_controls else ""
	if uses_controls and (obstacle.is_empty() or _clips.is_used):
		var drawn := ControlsBody.new(_followed.shared.resources, source)
		drawn.problem = obstacle if obstacle else drawn.problem
		return drawn
	if source != null:
		source.free()
	if obstacle:
		push_warning("Puppetline: %s falls back to VERTICES: %s." % [_followed.name, obstacle])
	var body := VerticesBody.new(_followed.shared.resources)
	if mesh_source != null:
		body.problem = "the mode VERTICES shows the service's mesh; mesh_source is used by CONTROLS and MORPHS only"
	return body


func _shown_nodes() -> Array[Node3D]:
	return _display.nodes()


func _on_character_left() -> void:
	_shown = MixedPlayback.new()
	_display.clear()


func _on_state_changed(before: Stream.State) -> void:
	update_configuration_warnings()
	if before == Stream.State.CONNECTED:
		_followed.performer.clear()
		_followed.takes.clear()
		disconnected.emit()
	if _followed.is_connected_to_service():
		connected.emit()
	if _followed.link != null and _followed.link.state == Stream.State.REFUSED:
		var address := Connections.address(_followed.link.stream.host, _followed.link.stream.port)
		push_warning("Puppetline: %s refuses the connection: %s" % [address, _followed.link.stream.reason])
		refused.emit(_followed.link.stream.reason)
