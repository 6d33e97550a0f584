extends SceneTree
## Shows a character with the engine's clock while a movie is written: PORT, number of images, milliseconds that each
## takes.

var _puppet := Puppet3D.new()
var _images := 0


func _initialize() -> void:
	_puppet.port = int(OS.get_cmdline_user_args()[0])
	_puppet.clock = Puppet3D.Clock.ENGINE
	Engine.physics_jitter_fix = 0.0  # which makes the first images a little longer or shorter
	var camera := Camera3D.new()
	camera.position = Vector3(0.0, 0.0, 5.0)
	root.add_child(camera)
	root.add_child(DirectionalLight3D.new())
	root.add_child(_puppet)


## Report what the image of the previous frame shows.
func _process(_delta: float) -> bool:
	if _images > 0:
		print("RESULT ", JSON.stringify(_puppet.statistics(), "", false, true))
	_images += 1
	OS.delay_msec(int(OS.get_cmdline_user_args()[2]))
	return _images > int(OS.get_cmdline_user_args()[1])
