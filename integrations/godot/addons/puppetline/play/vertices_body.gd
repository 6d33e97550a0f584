extends "body.gd"
## A character whose vertices come from the service in each frame, for meshes that exceed the limits of controls.
##
## It shows the earlier frame without interpolation, which would require another upload of each frame.

const RestMesh := preload("rest_mesh.gd")
const Surfaces := preload("surfaces.gd")
const Materials := preload("materials.gd")
const Vertices16 := preload("vertices16.gd")
const VerticesMotion := preload("vertices_motion.gd")

var _numbers: ImageTexture
var _surfaces: Surfaces
var _shown: Message
var _shift := Vector3.ZERO


func _init(of: SceneResources) -> void:
	resources = of
	var empty := PackedByteArray()
	empty.resize(frame_size())
	_numbers = ImageTexture.create_from_image(_image(empty))
	_surfaces = Surfaces.new(resources, not resources.scene.colors.is_empty())
	var instance := MeshInstance3D.new()
	instance.mesh = resources.mesh
	add_child(instance)
	_surfaces.add(instance, Materials.of_scene(resources.scene), Basis.IDENTITY)
	_surfaces.set_parameter(&"puppet_frame_0", _numbers)
	_surfaces.set_parameter(&"puppet_by_vertices", true)
	_surfaces.set_parameter(&"puppet_positions_start", Vertices16.positions_start())
	_surfaces.set_parameter(&"puppet_normals_start", Vertices16.normals_start(resources.scene.vertex_count))


func payload_name() -> String:
	return "vertices16"


func frame_size() -> int:
	return Vertices16.size(resources.scene.vertex_count)


func set_materials(materials: Array[Material]) -> void:
	_surfaces.set_materials(materials)


func show_frames(earlier: Message, _later: Message, _share: float) -> void:
	_surfaces.follow_materials()
	if _shown == earlier:
		return
	_shown = earlier
	_shift = shift(earlier, earlier, 0.0)
	_numbers.update(_image(earlier.payload))
	var box := Vertices16.box(earlier.payload)
	_surfaces.set_parameter(&"puppet_shift", _shift)
	_surfaces.set_parameter(&"puppet_box_position", box.position)
	_surfaces.set_parameter(&"puppet_box_size", box.size)
	_surfaces.set_bounds(AABB(box.position + _shift, box.size) if box.is_finite() else resources.scene.bounds)


func shown_share(_share: float) -> float:
	return 0.0


func follow_patch(patch: SurfacePatch) -> PatchMotion:
	return VerticesMotion.new(patch)


func evaluate() -> PackedVector3Array:
	var positions := PackedVector3Array()
	if _shown == null:
		return positions
	var box := Vertices16.box(_shown.payload)
	positions.resize(resources.scene.vertex_count)
	for vertex in positions.size():
		positions[vertex] = _shift + Vertices16.position(_shown.payload, box, vertex)
	return positions


## Return an image with one pixel per 16-bit number of a frame.
func _image(payload: PackedByteArray) -> Image:
	var bytes := RestMesh.pad_rows(payload.duplicate(), Vertices16.NUMBER_BYTES)
	return RestMesh.image(bytes, Image.FORMAT_RG8, Vertices16.NUMBER_BYTES)
