extends RefCounted
## Loads a scene, and makes the resources of it, in a thread of the engine.

const SceneLoading := preload("scene_loading.gd")
const SceneResources := preload("scene_resources.gd")
const SceneCache := preload("../wire/scene_cache.gd")
const Scene := preload("../wire/scene.gd")
const Message := preload("../wire/message.gd")

## Maximum time for which the end of the program waits for threads, in milliseconds.
const _MAX_END_MS := 5000

static var _running: Array[SceneLoading] = []  # also those whose results are not needed any more

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


## Return whether loading has ended, with a result or without one.
func is_done() -> bool:
	if _task >= 0 and WorkerThreadPool.is_task_completed(_task):
		WorkerThreadPool.wait_for_task_completion(_task)  # releases it
		_task = -1
		_running.erase(self)
	return _task < 0


func _start(work: Callable) -> void:
	_release_ended()
	var root := (Engine.get_main_loop() as SceneTree).root
	if not root.tree_exiting.is_connected(_end):
		root.tree_exiting.connect(_end)
	_task = WorkerThreadPool.add_task(work)
	_running.append(self)


static func _release_ended() -> void:
	for each: SceneLoading in _running.duplicate():
		each.is_done()


## Wait for all threads at the end of the program, because a script that still runs then would crash it. A thread could
## be waiting for the main thread, so the time is limited.
static func _end() -> void:
	var give_up := Time.get_ticks_msec() + _MAX_END_MS
	_release_ended()
	while not _running.is_empty() and Time.get_ticks_msec() < give_up:
		OS.delay_msec(1)
		_release_ended()


func _make(payload: PackedByteArray, of_digest: String, with_mesh: bool) -> void:
	var scene := Scene.parse(payload) if not payload.is_empty() else null
	if scene != null:
		resources = SceneResources.new(scene)
		resources.make(with_mesh)
		digest = of_digest
