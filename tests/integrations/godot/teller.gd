extends RefCounted
## Base of the test scripts, which report results to the test. resident.gd runs them one after another.

const Resident := preload("resident.gd")

var root: Window:
	get:
		return _resident().root
var process_frame: Signal:
	get:
		return _resident().process_frame
var is_done := false


## Called once; `start` and `step` stand for the _initialize and _process of a SceneTree.
func start() -> void:
	pass


## Called before each frame; return whether the script is done.
func step(_delta: float) -> bool:
	return false


## Be done, for scripts without `step`.
func quit() -> void:
	is_done = true


func tell(what: Dictionary) -> void:
	print("RESULT ", JSON.stringify(what, "", false, true))


## Return whether the test has ended the script.
func is_over() -> bool:
	return _resident().is_over()


func arguments() -> PackedStringArray:
	return _resident().arguments


func create_timer(seconds: float) -> SceneTreeTimer:
	return _resident().create_timer(seconds)


func base64(bytes: PackedByteArray) -> String:
	return "" if bytes.is_empty() else Marshalls.raw_to_base64(bytes)


func sha256(bytes: PackedByteArray) -> String:
	var context := HashingContext.new()
	context.start(HashingContext.HASH_SHA256)
	if not bytes.is_empty():
		context.update(bytes)
	return context.finish().hex_encode()


func _resident() -> Resident:
	return Engine.get_main_loop()
