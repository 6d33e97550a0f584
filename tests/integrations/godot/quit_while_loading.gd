extends SceneTree
## Quits while a thread loads a scene.

const SceneLoading := preload("res://addons/puppetline/play/scene_loading.gd")


func _initialize() -> void:
	SceneLoading.new()._start(_load)
	quit()


func _load() -> void:
	OS.delay_msec(700)
	print("loaded")
