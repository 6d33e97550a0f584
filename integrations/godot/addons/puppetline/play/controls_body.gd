extends "body.gd"
## A character that the graphics card moves: each frame is some 80 transforms, whatever the mesh.

const RestMesh := preload("rest_mesh.gd")
const Surfaces := preload("surfaces.gd")
const Materials := preload("materials.gd")
const IsolineBounds := preload("isoline_bounds.gd")
const OwnMesh := preload("own_mesh.gd")

## Bytes of a transform.
const _TRANSFORM := 48

var _surfaces: Surfaces
var _bounds: IsolineBounds
var _transforms := 0
## Two frames are on the graphics card, and one of them stays there when the time between the next two begins.
var _textures: Array[ImageTexture] = []
var _held: Array[Message] = [null, null]
var _boxes: Array[AABB] = [AABB(), AABB()]
var _weight := 0.0  # of the second one
var _shift := Vector3.ZERO


## `source` is the user's own character, which becomes a child of this node, or null for the mesh of the scene. That is
## shown as well where there is a problem with the user's own.
func _init(of: SharedScene, source: Node3D) -> void:
	shared = of
	_transforms = shared.scene.field_count * shared.scene.isoline_count
	_bounds = shared.bounds
	var empty := PackedByteArray()
	empty.resize(frame_size())
	for i in 2:
		_textures.append(ImageTexture.create_from_image(_image(empty)))
	if source != null:
		add_child(source)
		_surfaces = Surfaces.new(shared, false)
		problem = OwnMesh.find(source, shared.scene, _surfaces)
		if problem:
			source.free()
			_surfaces = null
	if _surfaces == null:
		_surfaces = Surfaces.new(shared, not shared.scene.colors.is_empty())
		_add_scene()
	_surfaces.set_parameter(&"puppet_frame_0", _textures[0])
	_surfaces.set_parameter(&"puppet_frame_1", _textures[1])
	_surfaces.set_parameter(&"puppet_by_vertices", false)


func word() -> String:
	return "controls"


func frame_size() -> int:
	return _transforms * _TRANSFORM


func dress(materials: Array[Material]) -> void:
	_surfaces.dress(materials)


func show_frames(earlier: Message, later: Message, share: float) -> void:
	var first := 1 if _held[1] == earlier or (_held[0] == later and earlier != later) else 0
	var uploaded := _hold(first, earlier)
	uploaded = _hold(1 - first, later) or uploaded
	_weight = share if first == 0 else 1.0 - share
	_surfaces.set_parameter(&"puppet_share", _weight)
	_shift = shift(earlier, later, share)
	if not follow_root:
		_surfaces.set_parameter(&"puppet_shift", _shift)
	if uploaded:
		_surfaces.set_bounds(_boxes[0].merge(_boxes[1]))


func evaluate() -> PackedVector3Array:
	if _held[0] == null:
		return PackedVector3Array()
	var transforms := _mixed_transforms()
	var scene := shared.scene
	var last := scene.isoline_count - 2
	var positions := PackedVector3Array()
	positions.resize(scene.vertex_count)
	for vertex in scene.vertex_count:
		var rest := scene.positions[vertex]
		var position := _shift
		for field in scene.field_count:
			var rung := scene.ladder[vertex * scene.field_count + field]
			var isoline := clampi(int(rung), 0, last)
			var transform := field * scene.isoline_count + isoline
			var between := (transforms[transform] * rest).lerp(transforms[transform + 1] * rest, rung - isoline)
			position += scene.weights[field] * between
		positions[vertex] = position
	return positions


func _add_scene() -> void:
	var instance := MeshInstance3D.new()
	instance.mesh = shared.mesh
	add_child(instance)
	_surfaces.add(instance, Materials.of_scene(shared.scene), Basis.IDENTITY)


## Have a frame on the graphics card; true if it was not there.
func _hold(i: int, frame: Message) -> bool:
	if _held[i] == frame:
		return false
	_held[i] = frame
	_textures[i].update(_image(frame.payload))
	var box := _bounds.around(frame.payload)
	if not box.is_finite():
		box = shared.scene.bounds
	if not follow_root:
		box.position -= frame.root
	_boxes[i] = box
	return true


## A row for each transform, of its three rows.
func _image(payload: PackedByteArray) -> Image:
	return Image.create_from_data(3, _transforms, false, Image.FORMAT_RGBAF, payload)


func _mixed_transforms() -> Array[Transform3D]:
	var first := _held[0].payload.to_float32_array()
	var second := _held[1].payload.to_float32_array()
	var transforms: Array[Transform3D] = []
	for i in _transforms:
		var rows: Array[Vector4] = []
		for at in range(12 * i, 12 * i + 12, 4):
			var row := Vector4(first[at], first[at + 1], first[at + 2], first[at + 3])
			rows.append(row.lerp(Vector4(second[at], second[at + 1], second[at + 2], second[at + 3]), _weight))
		transforms.append(
			Transform3D(
				Vector3(rows[0].x, rows[1].x, rows[2].x),
				Vector3(rows[0].y, rows[1].y, rows[2].y),
				Vector3(rows[0].z, rows[1].z, rows[2].z),
				Vector3(rows[0].w, rows[1].w, rows[2].w)
			)
		)
	return transforms
