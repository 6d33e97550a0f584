extends RefCounted
## Reads back the results of a character's vertex shaders. Each vertex becomes one pixel, and its numbers become
## colours, with 12 bits of a number per image. Four bits per channel survive the colour processing of the renderer,
## which an image of a ramp measures.

const SIDE := 256
const NUMBERS := 9
const PICTURES := 1 + 2 * NUMBERS
const READER := """
shader_type spatial;
render_mode unshaded, cull_disabled, depth_test_disabled, shadows_disabled, fog_disabled;
#include "res://addons/puppetline/play/puppet.gdshaderinc"
uniform int picture;
uniform vec3 low;
uniform vec3 size;
varying flat int bits;

void vertex() {
	VERTEX = puppet_vertex(CUSTOM0, CUSTOM1, CUSTOM2, VERTEX, NORMAL, TANGENT, BINORMAL);
	vec3 place = (VERTEX - low) / size;
	int number = (picture - 1) / 2;
	vec3 turned = 0.25 * (number < 6 ? NORMAL : TANGENT) + 0.5;
	float value = number < 3 ? place[number] : turned[number % 3];
	int pixel = puppet_number(CUSTOM2);
	bits = int(clamp(value, 0.0, 1.0) * 16777215.0 + 0.5) >> (picture % 2 == 1 ? 12 : 0);
	if (picture == 0) {
		bits = (pixel % 16) * 273;
	}
	vec2 at = (vec2(float(pixel % SIDE), float(pixel / SIDE)) + 0.5) / float(SIDE);
	POSITION = vec4(2.0 * at.x - 1.0, 2.0 * at.y - 1.0, 0.5, 1.0);
	POINT_SIZE = 1.0;
}

void fragment() {
	ALBEDO = vec3(float((bits >> 8) & 15), float((bits >> 4) & 15), float(bits & 15)) / 15.0;
}
"""

var _viewport := SubViewport.new()
var _readers: Array[ShaderMaterial] = []
var _shader := Shader.new()


## Prepare for the meshes below a node, of which only the materials are used. All numbers are within `box`.
func _init(above: Node, shown: Node, box: AABB) -> void:
	_shader.code = READER.replace("SIDE", str(SIDE))
	_viewport.size = Vector2i(SIDE, SIDE)
	_viewport.own_world_3d = true
	_viewport.render_target_update_mode = SubViewport.UPDATE_ALWAYS
	_viewport.add_child(Camera3D.new())
	above.add_child(_viewport)
	for each: MeshInstance3D in shown.find_children("*", "MeshInstance3D", true, false):
		_add(each, box)


## Return the pixels of a ramp, and of two images per number of the position, the normal and the tangent.
func read() -> PackedByteArray:
	var pixels := PackedByteArray()
	for picture in PICTURES:
		for reader in _readers:
			reader.set_shader_parameter(&"picture", picture)
		await RenderingServer.frame_post_draw
		var image := _viewport.get_texture().get_image()
		image.convert(Image.FORMAT_RGB8)
		pixels.append_array(image.get_data())
	return pixels


func free_pictures() -> void:
	_viewport.free()


func _add(instance: MeshInstance3D, box: AABB) -> void:
	var points := ArrayMesh.new()
	for surface in instance.mesh.get_surface_count():
		var arrays := instance.mesh.surface_get_arrays(surface)
		var kept := []
		kept.resize(Mesh.ARRAY_MAX)
		var flags := 0
		kept[Mesh.ARRAY_VERTEX] = arrays[Mesh.ARRAY_VERTEX]
		kept[Mesh.ARRAY_NORMAL] = arrays[Mesh.ARRAY_NORMAL]
		kept[Mesh.ARRAY_TANGENT] = _tangents(arrays[Mesh.ARRAY_NORMAL])
		for custom in 3:
			var array := Mesh.ARRAY_CUSTOM0 + custom
			kept[array] = arrays[array]
			var floats: int = arrays[array].size() / arrays[Mesh.ARRAY_VERTEX].size()
			flags |= (Mesh.ARRAY_CUSTOM_R_FLOAT + floats - 1) << (Mesh.ARRAY_FORMAT_CUSTOM0_SHIFT + 3 * custom)
		points.add_surface_from_arrays(Mesh.PRIMITIVE_POINTS, kept, [], {}, flags)
		_readers.append(instance.get_surface_override_material(surface).duplicate())
		_readers[-1].shader = _shader
		_readers[-1].set_shader_parameter(&"low", box.position)
		_readers[-1].set_shader_parameter(&"size", box.size)
		points.surface_set_material(surface, _readers[-1])
	var reader := MeshInstance3D.new()
	reader.mesh = points
	reader.extra_cull_margin = 16384.0
	_viewport.add_child(reader)


## Make tangents that the test can reproduce and that differ from the tangents of the slopes.
func _tangents(normals: PackedVector3Array) -> PackedFloat32Array:
	var tangents := PackedFloat32Array()
	for normal in normals:
		var tangent := Vector3(0.3, -0.5, 0.8).cross(normal).normalized()
		tangents.append_array(PackedFloat32Array([tangent.x, tangent.y, tangent.z, 1.0]))
	return tangents
