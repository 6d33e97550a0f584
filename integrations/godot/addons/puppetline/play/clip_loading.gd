extends "scene_loading.gd"
## Reads a clip and its scene, immediately or in a thread of the engine.

const ClipLoading := preload("clip_loading.gd")
const ClipMessages := preload("../wire/clip_messages.gd")

## The contents of the clip; null until they have been read.
var messages: ClipMessages


## Read the data of a clip immediately. [param known] are resources by the digest of their scene, which are reused.
static func at_once(data: PackedByteArray, known: Dictionary) -> ClipLoading:
	var loading := ClipLoading.new()
	loading._read(data, known)
	return loading


## Start to read the data of a clip, and to make the resources of its scene.
static func in_thread(data: PackedByteArray, known: Dictionary, with_mesh: bool) -> ClipLoading:
	var loading := ClipLoading.new()
	loading._start(
		func() -> void:
			loading._read(data, known)
			if loading.resources != null and loading.digest not in known:
				loading.resources.make(with_mesh)
	)
	return loading


func _read(data: PackedByteArray, known: Dictionary) -> void:
	messages = ClipMessages.find(data)
	if messages.problem:
		return
	digest = SceneCache.digest_of(messages.scene)
	resources = known.get(digest)
	if resources == null:
		var scene := Scene.parse(messages.scene)
		resources = SceneResources.new(scene) if scene != null else null
	if resources == null:
		messages.fail("a damaged scene")
