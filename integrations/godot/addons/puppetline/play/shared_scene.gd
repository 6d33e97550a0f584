extends RefCounted
## The scene of one character of a service, and what is made of it once for all nodes that show this character.

## There is a scene, or another one.
signal changed

const SharedScene := preload("shared_scene.gd")
const Stream := preload("../wire/stream.gd")
const Message := preload("../wire/message.gd")
const Scene := preload("../wire/scene.gd")
const RestMesh := preload("rest_mesh.gd")
const IsolineBounds := preload("isoline_bounds.gd")

## Milliseconds between two questions, and while something comes in that may be the answer: on a slow line, each
## question puts a whole scene more into the queue.
const _ASK_INTERVAL := 1000
const _PATIENCE := 16_000

static var _all: Dictionary = {}  # key: WeakRef

## Null before it has come.
var scene: Scene

## What can be drawn of it: made when somebody asks, and kept.
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

var _key := ""
var _stream: Stream
var _receiver: Callable  # once this is being freed, it cannot be had any more
var _topic := ""
var _came := PackedInt64Array()  # what tells one scene message from another
var _wanted := true
var _asked := 0


func _init(stream: Stream, character: String) -> void:
	_stream = stream
	_topic = "%s/scene/%08x%08x" % [character, randi(), randi()]
	_receiver = _take
	_stream.follow(_topic, _receiver)
	_asked = Time.get_ticks_msec()


## Return the scene of a character; there is one for each stream and name, as long as anybody holds it.
static func shared(stream: Stream, character: String) -> SharedScene:
	var key := "%d/%s" % [stream.get_instance_id(), character]
	var found: SharedScene = _all[key].get_ref() if key in _all else null
	if found == null:
		found = SharedScene.new(stream, character)
		found._key = key
		_all[key] = weakref(found)
	return found


## Have the scene sent again: a frame has come that belongs to another one.
func ask() -> void:
	_wanted = true


## Ask as often as it is allowed, until it comes.
func poll() -> void:
	var pause := _PATIENCE if _stream.is_receiving() else _ASK_INTERVAL
	if _wanted and Time.get_ticks_msec() >= _asked + pause and _stream.state == Stream.State.CONNECTED:
		_asked = Time.get_ticks_msec()
		_stream.ask(_topic)


func _notification(what: int) -> void:
	if what == NOTIFICATION_PREDELETE and _stream != null:
		_stream.unfollow(_topic, _receiver)
		_all.erase(_key)


func _take(message: Message) -> void:
	_wanted = false
	var came := PackedInt64Array([message.revision, message.payload.size(), hash(message.payload)])
	if came == _came:
		return
	_came = came
	var found := Scene.parse(message.payload)
	if found == null:
		return
	scene = found
	mesh = null
	rest_texture = null
	slopes_texture = null
	bounds = null
	changed.emit()
