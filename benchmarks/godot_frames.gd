extends SceneTree
## Times the script of puppets: `godot … -s godot_frames.gd -- PORT FRAMES NAME…`, a Puppet3D for each name.

var _puppets: Array[Puppet3D] = []
var _wanted := 0
var _micros := PackedFloat64Array()
var _arrived := 0


func _initialize() -> void:
	var arguments := OS.get_cmdline_user_args()
	Engine.max_fps = 60
	_wanted = int(arguments[1])
	for name in arguments.slice(2):
		var puppet := Puppet3D.new()
		puppet.port = int(arguments[0])
		puppet.character = name
		root.add_child(puppet)
		puppet.set_process(false)  # it is called here, between two looks at the clock
		_puppets.append(puppet)


func _process(delta: float) -> bool:
	var begun := Time.get_ticks_usec()
	for puppet in _puppets:
		puppet._process(delta)
	var passed := Time.get_ticks_usec() - begun
	if _puppets.all(func(puppet: Puppet3D) -> bool: return puppet.statistics()["next_sequence"] > 90):
		_micros.append(passed)
		_arrived += int(_puppets[0].statistics()["frames_per_second"])
	if _micros.size() < _wanted:
		return false
	_micros.sort()
	var result := {
		"median_ms": 1e-3 * _micros[_micros.size() / 2],
		"p99_ms": 1e-3 * _micros[_micros.size() * 99 / 100],
		"arrived": _arrived / float(_micros.size()),
	}
	print("RESULT ", JSON.stringify(result))
	return true
