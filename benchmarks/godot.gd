extends SceneTree
## Times the characters of a running service in each frame, and attachments to the first one. Arguments: its port, names
## of characters. Prints JSON.

## Frames before the characters connect: the first ones of a program are long.
const START_FRAMES := 30
const WARM_UP_FRAMES := 120
const MEASURED_FRAMES := 600
const ATTACHMENT_COUNT := 16

var _puppets: Array[Puppet3D] = []
var _started_frames := 0
var _last_start := 0
var _loading := PackedFloat64Array()
var _counted_frames := 0
var _receiving := PackedFloat64Array()
var _processing := PackedFloat64Array()
var _attaching := PackedFloat64Array()
var _attachments: Array[PuppetAttachment3D] = []
var _first := 0
var _began := 0


func _initialize() -> void:
	Engine.max_fps = 0  # until the characters are loaded, the time between two frames is what they take
	OS.low_processor_usage_mode_sleep_usec = 1000  # without a display, the engine sleeps up to this time in each frame
	var arguments := OS.get_cmdline_user_args()
	for name in arguments.slice(1):
		var puppet := Puppet3D.new()
		puppet.port = int(arguments[0])
		puppet.character = name
		puppet.set_process(false)
		_puppets.append(puppet)
		root.add_child(puppet)


func _process(delta: float) -> bool:
	var start := Time.get_ticks_usec()
	_started_frames += 1
	if _started_frames <= START_FRAMES:
		_last_start = start
		return false
	if _counted_frames == 0:
		_loading.append(start - _last_start)
		_last_start = start
	if _puppets[0]._stream() != null:
		_puppets[0]._stream().poll()  # all nodes share the stream, which works once per frame
	var received := Time.get_ticks_usec()
	for puppet in _puppets:
		puppet._process(delta)
	var done := Time.get_ticks_usec()
	for attachment in _attachments:
		attachment._move()
	var attached := Time.get_ticks_usec()
	if not _puppets.all(func(puppet: Puppet3D) -> bool: return puppet.statistics()["sequence"] > 0):
		return false
	_counted_frames += 1
	Engine.max_fps = 60
	if _counted_frames == WARM_UP_FRAMES:
		_first = _sequences()
		_attach()
		_began = start
	if _counted_frames >= WARM_UP_FRAMES:
		_receiving.append((received - start) / float(_puppets.size()))
		_processing.append((done - received) / float(_puppets.size()))
	if _counted_frames > WARM_UP_FRAMES:
		_attaching.append((attached - done) / float(ATTACHMENT_COUNT))
	if _counted_frames < WARM_UP_FRAMES + MEASURED_FRAMES:
		return false
	var frames := (_sequences() - _first) / float(_puppets.size())
	var found := {
		"loading_us": Array(_loading),
		"receiving_us": Array(_receiving),
		"processing_us": Array(_processing),
		"attaching_us": Array(_attaching),
		"frames_a_second": frames / (1e-6 * (done - _began)),
		"renderer": RenderingServer.get_video_adapter_name(),
	}
	print("RESULT ", JSON.stringify(found))
	for puppet in _puppets:
		puppet.free()
	return true


func _sequences() -> int:
	var sum := 0
	for puppet in _puppets:
		sum += puppet.statistics()["sequence"]
	return sum


## Attach nodes to vertices all over the first character. They are moved by the benchmark, which times them, and not by
## the signal of the character.
func _attach() -> void:
	for i in ATTACHMENT_COUNT:
		var attachment := PuppetAttachment3D.new()
		_puppets[0].add_child(attachment)
		attachment.vertex = i * _puppets[0].get_character_scene().vertex_count / ATTACHMENT_COUNT
		_puppets[0].pose_updated.disconnect(attachment._move)
		_attachments.append(attachment)
