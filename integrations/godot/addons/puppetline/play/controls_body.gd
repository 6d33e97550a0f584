extends "body.gd"
## A character that the graphics card deforms. Each frame has about 80 transforms, whatever the size of the mesh.

const RestMesh := preload("rest_mesh.gd")
const Surfaces := preload("surfaces.gd")
const Materials := preload("materials.gd")
const ControlsMotion := preload("controls_motion.gd")
const IsolineBounds := preload("isoline_bounds.gd")
const OwnMesh := preload("own_mesh.gd")

## Number of floats in a transform, and in a row of the textures.
const _ROW_FLOATS := 12

var _surfaces: Surfaces
var _bounds: IsolineBounds
var _transform_count := 0
var _target_rows := 0  # after the transforms: the weights of the mesh's own targets
## Textures of the two frames on the graphics card. One of them stays there for the interpolation with the next frame.
var _textures: Array[ImageTexture] = []
var _frames: Array[Message] = [null, null]  # one of them is null if the other one is shown alone
var _boxes: Array[AABB] = [AABB(), AABB()]
var _weight := 0.0  # of the second one
var _mixed := PackedFloat32Array()  # the numbers between them; empty before they are needed
var _shift := Vector3.ZERO


## [param source] is the character from `mesh_source`, which becomes a child of this node, or null for the mesh of the
## scene. If [param source] has a problem, the mesh of the scene is shown instead.
func _init(of: SceneResources, source: Node3D) -> void:
	resources = of
	_transform_count = resources.scene.field_count * resources.scene.isoline_count
	_target_rows = ceili(float(resources.scene.displacement_count) / _ROW_FLOATS)
	_bounds = resources.bounds
	var empty := PackedFloat32Array()
	empty.resize(_ROW_FLOATS * (_transform_count + _target_rows))
	for i in 2:
		_textures.append(ImageTexture.create_from_image(_image(empty)))
	if source != null:
		add_child(source)
		_surfaces = Surfaces.new(resources, false)
		problem = OwnMesh.find(source, resources.scene, _surfaces)
		if problem:
			source.free()
			_surfaces = null
	if _surfaces == null:
		_surfaces = Surfaces.new(resources, not resources.scene.colors.is_empty())
		_add_scene()
	_surfaces.set_parameter(&"puppet_frame_0", _textures[0])
	_surfaces.set_parameter(&"puppet_frame_1", _textures[1])
	_surfaces.set_parameter(&"puppet_by_vertices", false)


func payload_name() -> String:
	return "controls"


func frame_size() -> int:
	return 4 * _ROW_FLOATS * _transform_count


func set_materials(materials: Array[Material]) -> void:
	_surfaces.set_materials(materials)


func show_frames(earlier: Message, later: Message, share: float) -> void:
	_surfaces.follow_materials()
	var first := 1 if _frames[1] == earlier or (_frames[0] == later and earlier != later) else 0
	var uploaded := _upload(first, earlier)
	if earlier != later:
		uploaded = _upload(1 - first, later) or uploaded
	elif uploaded or _frames[1 - first] != null:
		_frames[1 - first] = null
		_boxes[1 - first] = _boxes[first]
		uploaded = true
	_mixed.clear()
	_weight = share if first == 0 else 1.0 - share
	_surfaces.set_parameter(&"puppet_share", _weight)
	_shift = shift(earlier, later, share)
	if not follow_root:
		_surfaces.set_parameter(&"puppet_shift", _shift)
	if uploaded:
		_surfaces.set_bounds(_boxes[0].merge(_boxes[1]))


func follow_patch(patch: SurfacePatch) -> PatchMotion:
	return ControlsMotion.new(resources.scene, patch)


func piece_boxes() -> Array[AABB]:
	var boxes: Array[AABB] = []
	for piece in resources.ray.pieces():
		boxes.append(piece.box)
	return boxes


func piece_transforms() -> Array[Transform3D]:
	var transforms: Array[Transform3D] = []
	if not _has_frame():
		return transforms
	_bounds.read(_mixed_floats())
	for piece in resources.ray.pieces():
		var transform := _bounds.mean_transform(piece)
		transform.origin += _shift
		transforms.append(transform)
	return transforms


func intersect(from: Vector3, to: Vector3) -> Dictionary:
	if not _has_frame():
		return {}
	var hit := resources.ray.intersect(_mixed_floats(), from - _shift, to - _shift)
	if not hit.is_empty():
		hit["position"] += _shift
		hit["corners"] = Transform3D(Basis.IDENTITY, _shift) * (hit["corners"] as PackedVector3Array)
	return hit


func evaluate() -> PackedVector3Array:
	if not _has_frame():
		return PackedVector3Array()
	_bounds.read(_mixed_floats())
	var positions := PackedVector3Array()
	positions.resize(resources.scene.vertex_count)
	for vertex in positions.size():
		positions[vertex] = _shift + _bounds.position(resources.scene, vertex)
	return positions


func _add_scene() -> void:
	var instance := MeshInstance3D.new()
	instance.mesh = resources.mesh
	add_child(instance)
	_surfaces.add(instance, Materials.of_scene(resources.scene), Basis.IDENTITY)


func _has_frame() -> bool:
	return _frames[0] != null or _frames[1] != null


## Upload a frame to the graphics card; return false if it was already there.
func _upload(i: int, frame: Message) -> bool:
	if _frames[i] == frame:
		return false
	_frames[i] = frame
	var numbers := _numbers(frame)
	_textures[i].update(_image(numbers))
	var box := _bounds.around(numbers)
	if not box.is_finite():
		box = resources.scene.bounds
	if not follow_root:
		box.position -= frame.root
	_boxes[i] = box
	return true


## Return the transforms of a frame, and then the weights of the mesh's own targets.
func _numbers(frame: Message) -> PackedFloat32Array:
	var numbers := frame.payload.to_float32_array()
	numbers.append_array(frame.targets.slice(0, resources.scene.displacement_count))
	numbers.resize(_ROW_FLOATS * (_transform_count + _target_rows))
	return numbers


## Return an image with one row per transform, whose pixels are the three rows of its matrix, and rows of weights.
func _image(numbers: PackedFloat32Array) -> Image:
	return Image.create_from_data(
		3, _transform_count + _target_rows, false, Image.FORMAT_RGBAF, numbers.to_byte_array()
	)


## Return the numbers between the two frames, computed once for each pose.
func _mixed_floats() -> PackedFloat32Array:
	if _mixed.is_empty():
		_mixed = _numbers(_frames[0] if _frames[0] != null else _frames[1])
		if _frames[0] != null and _frames[1] != null:
			var second := _numbers(_frames[1])
			for i in _mixed.size():
				_mixed[i] = lerpf(_mixed[i], second[i], _weight)
	return _mixed
