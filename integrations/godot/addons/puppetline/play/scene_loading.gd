extends RefCounted
## Loads a scene, and makes the resources of it, in a thread of the engine.

const SceneLoading := preload("scene_loading.gd")
const SceneResources := preload("scene_resources.gd")
const SceneCache := preload("../wire/scene_cache.gd")
const Scene := preload("../wire/scene.gd")
const Message := preload("../wire/message.gd")

static var _abandoned: Array[SceneLoading] = []

## The result; null if there is none.
var resources: SceneResources
## Digest of the payload; empty if there is no result.
var digest := ""

var _task := -1


## Start to load the scene of a message, and to keep it in the cache.
static func of_message(message: Message, with_mesh: bool) -> SceneLoading:
	var loading := SceneLoading.new()
	loading._start(
		func() -> void:
			var payload := message.payload
			loading._make(payload, SceneCache.digest_of(payload), with_mesh)
			if loading.resources != null:
				SceneCache.save(loading.digest, payload)
	)
	return loading


## Start to load the scene with a digest from the cache.
static func of_cache(from_digest: String, with_mesh: bool) -> SceneLoading:
	var loading := SceneLoading.new()
	loading._start(func() -> void: loading._make(SceneCache.load_payload(from_digest), from_digest, with_mesh))
	return loading


## Return whether the result is there.
func is_done() -> bool:
	if _task >= 0 and WorkerThreadPool.is_task_completed(_task):
		WorkerThreadPool.wait_for_task_completion(_task)  # releases it
		_task = -1
	return _task < 0


## Let the thread end without waiting for it. A thread may wait for the main thread, when it makes a resource.
func abandon() -> void:
	if not is_done():
		_abandoned.append(self)


func _start(work: Callable) -> void:
	_abandoned = _abandoned.filter(func(each: SceneLoading) -> bool: return not each.is_done())
	_task = WorkerThreadPool.add_task(work)


func _make(payload: PackedByteArray, of_digest: String, with_mesh: bool) -> void:
	var scene := Scene.parse(payload) if not payload.is_empty() else null
	if scene != null:
		resources = SceneResources.new(scene)
		resources.make(with_mesh)
		digest = of_digest
