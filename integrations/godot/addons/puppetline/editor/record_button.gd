@tool
extends Button
## Button in the toolbar of the 3D view, which starts and stops the selected recorder.

## The selected recorder; null for none.
var recorder: PuppetRecorder:
	set(value):
		recorder = value
		_show()


func _init() -> void:
	text = "Record Clip"
	tooltip_text = "Record the performer, and save a clip that plays without a service."
	toggle_mode = true
	flat = true
	toggled.connect(_on_toggled)


func _process(_delta: float) -> void:
	_show()


func _show() -> void:
	var records := is_instance_valid(recorder) and recorder.is_recording()
	set_pressed_no_signal(records)
	text = "Record Clip (%.1f s)" % recorder.get_duration() if records else "Record Clip"


func _on_toggled(on: bool) -> void:
	if not is_instance_valid(recorder):
		return
	if not on:
		recorder.stop()
		return
	var error := recorder.start()
	if error != OK:
		push_warning("Puppetline: %s cannot record to %s: %s." % [recorder.name, recorder.path, error_string(error)])
