extends "teller.gd"
## Records a character of a running service: PORT PATH. Reports the number of each frame and the duration, and at the
## end what was saved. With "recover" for the port, it saves what another process has left.

var _puppet := Puppet3D.new()
var _recorder := PuppetRecorder.new()


func start() -> void:
	var asked := arguments()
	if asked[0] == "recover":
		tell({"recovered": PuppetRecorder.recover(asked[1], 0.0)})
		_recorder.free()
		_puppet.free()
		quit()
		return
	_puppet.port = int(asked[0])
	_recorder.path = asked[1]
	_recorder.saved.connect(func(to: String) -> void: tell({"saved": to}))
	_puppet.add_child(_recorder)
	root.add_child(_puppet)
	tell({"error": _recorder.start()})
	_puppet.frame_received.connect(
		func(frame: RefCounted) -> void: tell({"frame": frame.sequence, "seconds": _recorder.get_duration()})
	)


func step(_delta: float) -> bool:
	if is_done or not is_over():
		return is_done
	var clip := _recorder.stop()
	tell({"problem": clip.problem(), "frames": clip.frame_count(), "length": clip.length()})
	_puppet.free()
	return true
