extends "teller.gd"
## Shows a character with another clock, and reports the clock and the motion in each frame: PORT, "engine" or "manual".
## The engine's clock runs at full and half speed and is paused; the manual one is advanced by 1/60 s in each frame.

const PHASE_FRAMES := 60

var _puppet := Puppet3D.new()
var _time := 0.0
var _passed := 0.0  # of the engine, which scales it
var _frames := -1
var _is_manual := false


func start() -> void:
	_puppet.port = int(arguments()[0])
	_is_manual = arguments()[1] == "manual"
	_puppet.clock = Puppet3D.Clock.MANUAL if _is_manual else Puppet3D.Clock.ENGINE
	root.add_child(_puppet)


func step(delta: float) -> bool:
	_passed += delta
	var shown := _puppet.statistics()
	var is_ready: bool = shown["waiting"] > PHASE_FRAMES / 2 + 1 if _is_manual else shown["share"] > 0.0
	if _frames < 0 and not is_ready:
		return false
	_frames += 1
	var phase := _frames / PHASE_FRAMES
	var names := PackedStringArray(["manual"] if _is_manual else ["full", "half", "paused", "again"])
	if phase >= names.size():
		_puppet.free()
		return true
	var played := lerpf(shown["sequence"], shown["next_sequence"], shown["share"])
	tell({"phase": names[phase], "time": _time, "played": played, "passed": _passed})
	if _is_manual:
		_puppet.advance(1.0 / 60.0)
		_time += 1.0 / 60.0
		return false
	root.get_tree().paused = names[phase] == "paused"
	Engine.time_scale = 0.5 if names[phase] == "half" else 1.0
	return false
