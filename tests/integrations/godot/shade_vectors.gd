extends "teller.gd"
## Deforms the character of a folder of messages on the graphics card, and saves the results: FOLDER FILE.

const Scene := preload("res://addons/puppetline/wire/scene.gd")
const Message := preload("res://addons/puppetline/wire/message.gd")
const SceneResources := preload("res://addons/puppetline/play/scene_resources.gd")
const Body := preload("res://addons/puppetline/play/body.gd")
const ControlsBody := preload("res://addons/puppetline/play/controls_body.gd")
const VerticesBody := preload("res://addons/puppetline/play/vertices_body.gd")
const SurfacePatch := preload("res://addons/puppetline/play/surface_patch.gd")
const GpuReader := preload("gpu_reader.gd")

## Two frames, and the share of the second one.
const MOMENTS: Array[Array] = [
	[0, 0, 0.0], [0, 1, 0.0], [0, 1, 0.25], [1, 1, 0.0], [1, 2, 0.75], [2, 2, 0.0], [0, 2, 0.5]
]

var _resources: SceneResources
var _file: FileAccess


func start() -> void:
	root.disable_3d = true
	DisplayServer.window_set_size(Vector2i(64, 64))
	_file = FileAccess.open(arguments()[1], FileAccess.WRITE)
	_resources = SceneResources.new(Scene.parse(_message("scene").payload))
	await _show(ControlsBody.new(_resources, null))
	await _show(VerticesBody.new(_resources))
	_resources = null
	quit()


func _show(body: Body) -> void:
	root.add_child(body)
	body.set_materials([])
	var box := _resources.scene.bounds.grow(_resources.scene.diagonal)
	for moment in MOMENTS:
		body.show_frames(_frame(body, moment[0]), _frame(body, moment[1]), moment[2])
		var reader := GpuReader.new(root, body, box)
		_file.store_buffer(await reader.read())
		reader.free_pictures()
		var bounds := (body.find_children("*", "MeshInstance3D", true, false)[0] as MeshInstance3D).custom_aabb
		var corners := [bounds.position, bounds.end].map(
			func(corner: Vector3) -> Array: return [corner.x, corner.y, corner.z]
		)
		tell(
			{
				"mode": body.payload_name(),
				"moment": moment,
				"bounds": corners,
				"evaluated": base64(body.evaluate().to_byte_array()),
				"top": _top(body, moment),
				"box": [[box.position.x, box.position.y, box.position.z], [box.size.x, box.size.y, box.size.z]]
			}
		)
	body.free()


## Return the highest vertex at rest, and where the patch around it is.
func _top(body: Body, moment: Array) -> Array:
	var positions := _resources.scene.positions
	var top := 0
	for vertex in positions.size():
		top = vertex if positions[vertex].y > positions[top].y else top
	var motion := body.follow_patch(SurfacePatch.at_vertex(_resources.scene, top))
	var place := motion.between(_frame(body, moment[0]), _frame(body, moment[1]), body.shown_share(moment[2]))[0]
	return [top, place.x, place.y, place.z]


func _frame(body: Body, number: int) -> Message:
	return _message("%d.%s" % [number, body.payload_name()])


func _message(name: String) -> Message:
	return Message.parse(FileAccess.get_file_as_bytes("%s/%s.bin" % [arguments()[0], name]))
