extends "body.gd"
## A character whose vertices come from the service in each frame, for meshes that exceed the limits of controls.
##
## It shows the earlier frame without interpolation, which would require another upload of each frame.

const RestMesh := preload("rest_mesh.gd")
const Surfaces := preload("surfaces.gd")
const Materials := preload("materials.gd")
const VerticesMotion := preload("vertices_motion.gd")

## Size of a position or a normal, in bytes.
const _VECTOR_BYTES := 12

var _instance := MeshInstance3D.new()
var _mesh: ArrayMesh
var _normals: ImageTexture
var _surfaces: Surfaces
var _shown: Message
var _shift := Vector3.ZERO


func _init(of: SharedScene) -> void:
	shared = of
	_mesh = RestMesh.build(shared.scene, Mesh.ARRAY_FLAG_USE_DYNAMIC_UPDATE)
	_normals = RestMesh.texture(
		RestMesh.pad_rows(shared.scene.normals.to_byte_array(), _VECTOR_BYTES), Image.FORMAT_RGBF, _VECTOR_BYTES
	)
	_instance.mesh = _mesh
	add_child(_instance)
	_surfaces = Surfaces.new(shared, not shared.scene.colors.is_empty())
	_surfaces.add(_instance, Materials.of_scene(shared.scene), Basis.IDENTITY)
	_surfaces.set_parameter(&"puppet_frame_0", _normals)
	_surfaces.set_parameter(&"puppet_by_vertices", true)


func payload_name() -> String:
	return "vertices"


func frame_size() -> int:
	return 2 * _VECTOR_BYTES * shared.scene.vertex_count


func set_materials(materials: Array[Material]) -> void:
	_surfaces.set_materials(materials)


func show_frames(earlier: Message, _later: Message, _share: float) -> void:
	_surfaces.follow_materials()
	if _shown == earlier:
		return
	_shown = earlier
	_shift = shift(earlier, earlier, 0.0)
	_surfaces.set_parameter(&"puppet_shift", _shift)
	_upload(earlier.payload)
	var box := _box_around(_positions())
	_surfaces.set_bounds(AABB(box.position + _shift, box.size) if box.is_finite() else shared.scene.bounds)


func shown_share(_share: float) -> float:
	return 0.0


func follow_patch(patch: SurfacePatch) -> PatchMotion:
	return VerticesMotion.new(patch)


func evaluate() -> PackedVector3Array:
	return Transform3D(Basis.IDENTITY, _shift) * _positions() if _shown != null else PackedVector3Array()


## Positions have the same layout in the mesh as in the payload, one surface after another. Normals go into a texture,
## because a mesh requires another encoding.
func _upload(payload: PackedByteArray) -> void:
	var parts := RestMesh.drawn_parts(shared.scene)
	for surface in parts.size():
		var first: int = parts[surface]["vertices"][0]
		var end: int = first + parts[surface]["vertices"][1]
		RenderingServer.mesh_surface_update_vertex_region(
			_mesh.get_rid(), surface, 0, payload.slice(first * _VECTOR_BYTES, end * _VECTOR_BYTES)
		)
	var normals := RestMesh.pad_rows(payload.slice(payload.size() / 2), _VECTOR_BYTES)
	_normals.update(RestMesh.image(normals, Image.FORMAT_RGBF, _VECTOR_BYTES))


## Return the received positions. They are decoded in the format of [method @GlobalScope.var_to_bytes], which needs no
## loop.
func _positions() -> PackedVector3Array:
	var written := PackedByteArray()
	written.resize(8)
	written.encode_u32(0, TYPE_PACKED_VECTOR3_ARRAY)
	written.encode_u32(4, shared.scene.vertex_count)
	written.append_array(_shown.payload.slice(0, _shown.payload.size() / 2))
	return bytes_to_var(written)


## Return the bounding box of points. The engine computes it, because a loop in script would be slow.
static func _box_around(points: PackedVector3Array) -> AABB:
	var arrays := []
	arrays.resize(Mesh.ARRAY_MAX)
	arrays[Mesh.ARRAY_VERTEX] = points
	var cloud := ArrayMesh.new()
	cloud.add_surface_from_arrays(Mesh.PRIMITIVE_POINTS, arrays)
	return cloud.get_aabb()
