extends "teller.gd"
## Mixes a clip with a performer: PORT CLIP WEIGHT... Reports the positions of all vertices at one moment for each
## `live_weight`.

var _puppet := Puppet3D.new()
var _frames := 0


func start() -> void:
	var clip := PuppetClip.new()
	clip.data = FileAccess.get_file_as_bytes(arguments()[1])
	_puppet.clip = clip
	_puppet.clip_speed = 0.0
	_puppet.live_weight = 0.001
	_puppet.clock = Puppet3D.Clock.MANUAL
	_puppet.port = int(arguments()[0])
	_puppet.frame_received.connect(func(_frame: RefCounted) -> void: _frames += 1)
	root.add_child(_puppet)


func step(_delta: float) -> bool:
	if _frames < 30:
		return false
	_puppet.advance(0.0)
	_puppet.advance(0.51)
	for weight in arguments().slice(2):
		_puppet.live_weight = float(weight)
		_puppet.advance(0.0)
		tell({"positions": base64(_puppet.evaluate().to_byte_array())})
	tell({"warnings": _puppet._get_configuration_warnings(), "state": _puppet.statistics()})
	_puppet.free()
	return true
