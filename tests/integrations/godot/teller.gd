extends SceneTree
## Base of the test scripts, which report results to the test until it ends them.


func _initialize() -> void:
	Engine.max_fps = 120


func tell(what: Dictionary) -> void:
	print("RESULT ", JSON.stringify(what, "", false, true))


## Return whether the test has ended the script.
func is_over() -> bool:
	return FileAccess.file_exists(OS.get_environment("PUPPETLINE_TEST_OVER"))


func arguments() -> PackedStringArray:
	return OS.get_cmdline_user_args()


func base64(bytes: PackedByteArray) -> String:
	return "" if bytes.is_empty() else Marshalls.raw_to_base64(bytes)


func sha256(bytes: PackedByteArray) -> String:
	var context := HashingContext.new()
	context.start(HashingContext.HASH_SHA256)
	if not bytes.is_empty():
		context.update(bytes)
	return context.finish().hex_encode()
