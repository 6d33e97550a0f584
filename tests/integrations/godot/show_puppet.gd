extends "teller.gd"
## Shows a character and reports the shown frames: {"settings": properties of Puppet3D, "samples": number of frames,
## "apart": minimum number of frames between two samples, "file": path of the positions, 3 floats per vertex; in MORPHS,
## the rest positions come first}.

const SIGNALS: Array[StringName] = [
	&"connected",
	&"disconnected",
	&"refused",
	&"scene_loaded",
	&"performer_found",
	&"performer_calibrated",
	&"performer_lost",
	&"take_started",
	&"take_stopped",
]

var _puppet := Puppet3D.new()
var _wanted := 0
var _file: FileAccess
var _apart := 1
var _next := 0


func start() -> void:
	var asked: Dictionary = JSON.parse_string(arguments()[0])
	_wanted = asked["samples"]
	_apart = asked["apart"]
	_file = FileAccess.open(asked["file"], FileAccess.WRITE)
	var settings: Dictionary = asked["settings"]
	for property: String in settings:
		_puppet.set(property, load(settings[property]) if property == "mesh_source" else settings[property])
	for happening in SIGNALS:
		_puppet.connect(happening, func(what: Variant = null) -> void: tell({"signal": happening, "what": what}))
	_puppet.scene_loaded.connect(
		func() -> void: _file.store_buffer(_puppet.evaluate().to_byte_array()), CONNECT_ONE_SHOT
	)
	_puppet.disconnected.connect(func() -> void: _next = 0)
	root.add_child(_puppet)


## Report the nodes' current state, which they have shown since the previous frame.
func step(_delta: float) -> bool:
	var shown := _puppet.statistics()
	if shown["calibrated"] and shown["sequence"] >= _next:
		_next = shown["sequence"] + _apart
		_file.store_buffer(_puppet.evaluate().to_byte_array())
		tell(shown)
		_wanted -= 1
	if _wanted == 0:
		_puppet.free()
	return _wanted == 0
