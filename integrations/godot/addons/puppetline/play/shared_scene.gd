extends RefCounted
## The scene of one character of a service, and the resources made from it, shared by all nodes that show the character.

## Emitted when a scene has arrived or changed.
signal changed

const SharedScene := preload("shared_scene.gd")
const Connection := preload("../wire/connection.gd")
const Stream := preload("../wire/stream.gd")
const Message := preload("../wire/message.gd")
const Scene := preload("../wire/scene.gd")
const SceneResources := preload("scene_resources.gd")
const SceneLoading := preload("scene_loading.gd")
const SceneCache := preload("../wire/scene_cache.gd")

const _CHARACTERS := "service/characters"
## Time between two requests of the scene, in milliseconds.
const _REQUEST_INTERVAL_MS := 1000
## Time between two requests while a message arrives that may be the scene, in milliseconds. On a slow network, each
## request queues another whole scene.
const _RECEIVING_INTERVAL_MS := 16_000

static var _scenes: Dictionary = {}  # key: WeakRef

## The newest version of the scene and its resources; null before it has arrived.
var resources: SceneResources
var scene: Scene:
	get:
		return resources.scene if resources != null else null
## Whether a node shows the service's mesh, which is then made in advance.
var shows_mesh := false

var _key := ""
var _stream: Stream
var _character := ""
var _on_characters: Callable  # new Callables cannot be made while this object is freed
var _on_scene: Callable
var _topic := ""
var _is_followed := false
var _is_listed := false  # whether the service has the character
var _announced_digest := ""  # of the service's version; empty if it announces none
var _digest := ""  # of this version
var _loading: SceneLoading
var _is_requested := true
var _requested_ms := -_RECEIVING_INTERVAL_MS


func _init(stream: Stream, character: String) -> void:
	_stream = stream
	_character = character
	if stream == null:
		return
	_topic = "%s/scene/%08x%08x" % [character, randi(), randi()]
	_on_characters = _take_characters
	_on_scene = _take_scene
	_stream.follow(_CHARACTERS, _on_characters)


## Return the scene of a character: one object per stream and name, as long as a reference to it exists.
static func shared(stream: Stream, character: String) -> SharedScene:
	var key := "%d/%s" % [stream.get_instance_id(), character]
	var found: SharedScene = _scenes[key].get_ref() if key in _scenes else null
	if found == null:
		found = SharedScene.new(stream, character)
		found._key = key
		_scenes[key] = weakref(found)
	return found


## Return the scene with a digest that does not come from a service: one object per digest, as long as a reference to it
## exists.
static func of_resources(known: SceneResources, digest: String) -> SharedScene:
	var found: SharedScene = _scenes[digest].get_ref() if digest in _scenes else null
	if found == null:
		found = SharedScene.new(null, "")
		found.resources = known
		found._digest = digest
		found._key = digest
		_scenes[digest] = weakref(found)
	return found


## Return the resources of all scenes by digest.
static func known_resources() -> Dictionary:
	var known := {}
	for key: String in _scenes:
		var each: SharedScene = _scenes[key].get_ref()
		if each.resources != null:
			known[each._digest] = each.resources
	return known


## Request the scene again, because a frame of another revision has arrived.
func ask() -> void:
	_is_requested = true


## Take what has been loaded, and send requests at the allowed rate until the scene arrives.
func poll() -> void:
	_is_listed = _is_listed and _stream.state == Stream.State.CONNECTED
	if _loading != null:
		_take_loaded()
		return
	var pause := _RECEIVING_INTERVAL_MS if _stream.is_receiving() else _REQUEST_INTERVAL_MS
	if _is_requested and _is_listed and Connection.now_ms() >= _requested_ms + pause:
		_requested_ms = Connection.now_ms()
		_request()


func _notification(what: int) -> void:
	if what != NOTIFICATION_PREDELETE:
		return
	_scenes.erase(_key)
	if _stream != null:
		_stream.unfollow(_CHARACTERS, _on_characters)
		_stream.unfollow(_topic, _on_scene)


func _request() -> void:
	if _announced_digest != _digest and SceneCache.has(_announced_digest):
		_loading = SceneLoading.of_cache(_announced_digest, shows_mesh)
	elif _is_followed:
		_stream.ask(_topic)
	else:
		_is_followed = true
		_stream.follow(_topic, _on_scene)


## Find out which version of the character the service has. A new connection may be to another service; later versions
## are noticed by the revision of their frames.
func _take_characters(message: Message) -> void:
	var list: Variant = message.json()
	var was_listed := _is_listed
	_is_listed = false
	for each: Variant in list if list is Array else []:
		if each is Dictionary and str(each.get("name")) == _character:
			_is_listed = true
			_announced_digest = str(each.get("digest", ""))
	if _is_listed and not was_listed and (_announced_digest.is_empty() or _announced_digest != _digest):
		ask()


func _take_scene(message: Message) -> void:
	_is_requested = false
	_is_followed = false
	_stream.unfollow(_topic, _on_scene)
	_loading = SceneLoading.of_message(message, shows_mesh)


func _take_loaded() -> void:
	if not _loading.is_done():
		return
	var loaded := _loading
	_loading = null
	if loaded.resources == null:
		return  # a request for a damaged file stays
	_is_requested = false
	if loaded.digest != _digest:
		_digest = loaded.digest
		resources = loaded.resources
		changed.emit()
