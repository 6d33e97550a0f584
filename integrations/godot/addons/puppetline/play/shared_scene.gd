extends RefCounted
## The scene of one character of a service, and the resources made from it, shared by all nodes that show the character.

## Emitted when a scene has arrived or changed.
signal changed

const SharedScene := preload("shared_scene.gd")
const Stream := preload("../wire/stream.gd")
const Message := preload("../wire/message.gd")
const Scene := preload("../wire/scene.gd")
const RestMesh := preload("rest_mesh.gd")
const IsolineBounds := preload("isoline_bounds.gd")
const SurfaceRay := preload("surface_ray.gd")

## Time between two requests of the scene, in milliseconds.
const _REQUEST_INTERVAL_MS := 1000
## Time between two requests while a message arrives that may be the scene, in milliseconds. On a slow network, each
## request queues another whole scene.
const _RECEIVING_INTERVAL_MS := 16_000

static var _scenes: Dictionary = {}  # key: WeakRef

## The scene; null before it has arrived.
var scene: Scene

## Resources made from the scene on first use.
var mesh: ArrayMesh:
	get:
		if mesh == null:
			mesh = RestMesh.build(scene)
		return mesh
var rest_texture: ImageTexture:
	get:
		if rest_texture == null:
			rest_texture = RestMesh.rest_texture(scene)
		return rest_texture
var slopes_texture: ImageTexture:
	get:
		if slopes_texture == null:
			slopes_texture = RestMesh.slopes_texture(scene)
		return slopes_texture
var bounds: IsolineBounds:
	get:
		if bounds == null:
			bounds = IsolineBounds.new(scene)
		return bounds
var ray: SurfaceRay:
	get:
		if ray == null:
			ray = SurfaceRay.new(self)
		return ray

var _key := ""
var _stream: Stream
var _receiver: Callable  # a new Callable cannot be made while this object is freed
var _topic := ""
var _signature := PackedInt64Array()  # distinguishes scene messages
var _is_requested := true
var _requested_ms := 0


func _init(stream: Stream, character: String) -> void:
	_stream = stream
	if stream == null:
		return
	_topic = "%s/scene/%08x%08x" % [character, randi(), randi()]
	_receiver = _take_scene
	_stream.follow(_topic, _receiver)
	_requested_ms = Time.get_ticks_msec()


## Return the scene of a character: one object per stream and name, as long as a reference to it exists.
static func shared(stream: Stream, character: String) -> SharedScene:
	var key := "%d/%s" % [stream.get_instance_id(), character]
	var found: SharedScene = _scenes[key].get_ref() if key in _scenes else null
	if found == null:
		found = SharedScene.new(stream, character)
		found._key = key
		_scenes[key] = weakref(found)
	return found


## Return the scene of a message that does not come from a service: one object per message, as long as a reference to
## it exists. It is null if the message is damaged.
static func of_payload(payload: PackedByteArray) -> SharedScene:
	var key := "%d/%d" % [payload.size(), hash(payload)]
	var found: SharedScene = _scenes[key].get_ref() if key in _scenes else null
	if found == null or found.scene.encoded != payload:
		var known := Scene.parse(payload)
		if known == null:
			return null
		found = SharedScene.new(null, "")
		found.scene = known
		found._key = key
		_scenes[key] = weakref(found)
	return found


## Request the scene again, because a frame of another revision has arrived.
func ask() -> void:
	_is_requested = true


## Send requests at the allowed rate until the scene arrives.
func poll() -> void:
	var pause := _RECEIVING_INTERVAL_MS if _stream.is_receiving() else _REQUEST_INTERVAL_MS
	if _is_requested and Time.get_ticks_msec() >= _requested_ms + pause and _stream.state == Stream.State.CONNECTED:
		_requested_ms = Time.get_ticks_msec()
		_stream.ask(_topic)


func _notification(what: int) -> void:
	if what != NOTIFICATION_PREDELETE:
		return
	_scenes.erase(_key)
	if _stream != null:
		_stream.unfollow(_topic, _receiver)


func _take_scene(message: Message) -> void:
	_is_requested = false
	var signature := PackedInt64Array([message.revision, message.payload.size(), hash(message.payload)])
	if signature == _signature:
		return
	_signature = signature
	var found := Scene.parse(message.payload)
	if found == null:
		return
	scene = found
	mesh = null
	rest_texture = null
	slopes_texture = null
	bounds = null
	ray = null
	changed.emit()
