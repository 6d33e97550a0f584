extends "teller.gd"
## Shows a character and tells what is shown, frame by frame: {"settings": properties of Puppet3D, "samples": how many,
## "apart": frames between two of them at least, "file": where positions are written, 3 floats a vertex; in MORPHS,
## those at rest first, "then": other properties, for when a service has refused it}.

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


func _initialize() -> void:
	super()
	var asked: Dictionary = JSON.parse_string(arguments()[0])
	_wanted = asked["samples"]
	_apart = asked["apart"]
	_file = FileAccess.open(asked["file"], FileAccess.WRITE)
	_apply(asked["settings"])
	for happening in SIGNALS:
		_puppet.connect(happening, func(what: Variant = null) -> void: tell({"signal": happening, "what": what}))
	_puppet.scene_loaded.connect(
		func() -> void: _file.store_buffer(_puppet.evaluate().to_byte_array()), CONNECT_ONE_SHOT
	)
	_puppet.refused.connect(func(_why: String) -> void: _apply(asked["then"]))
	_puppet.disconnected.connect(func() -> void: _next = 0)
	root.add_child(_puppet)


## What nodes show by now, they have shown in the frame before.
func _process(_delta: float) -> bool:
	var shown := _puppet.statistics()
	if shown["calibrated"] and shown["sequence"] >= _next:
		_next = shown["sequence"] + _apart
		_file.store_buffer(_puppet.evaluate().to_byte_array())
		tell(shown)
		_wanted -= 1
	if _wanted == 0:
		_puppet.free()
	return _wanted == 0


func _apply(settings: Dictionary) -> void:
	for property: String in settings:
		_puppet.set(property, load(settings[property]) if property == "mesh_source" else settings[property])
