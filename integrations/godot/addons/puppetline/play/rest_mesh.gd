extends RefCounted
## The constant data of a character on the graphics card: the mesh in its rest pose, and textures by vertex number.
##
## Each part of the scene is a surface. CUSTOM0 and CUSTOM1 contain the isoline coordinates, CUSTOM2.x the vertex
## number. The shader reads positions and normals from a texture, which keeps them exact. In a mesh, Godot rounds
## normals, and the importer also rounds positions.

const Scene := preload("../wire/scene.gd")

## Maximum number of fields, whose isoline coordinates fit into CUSTOM0 and CUSTOM1.
const MAX_FIELDS := 8
## Maximum number of rows of a texture that every graphics card supports.
const MAX_TEXTURE_ROWS := 16384
## Number of texels per row, which every graphics card supports.
const _TEXTURE_WIDTH := 2048
## Angles between normals that the levels of detail may merge and must split, which are the importer's defaults.
const _LOD_MERGE_DEGREES := 60.0
const _LOD_SPLIT_DEGREES := 25.0
const _FORMAT := (
	(Mesh.ARRAY_CUSTOM_RGBA_FLOAT << Mesh.ARRAY_FORMAT_CUSTOM0_SHIFT)
	| (Mesh.ARRAY_CUSTOM_RGBA_FLOAT << Mesh.ARRAY_FORMAT_CUSTOM1_SHIFT)
	| (Mesh.ARRAY_CUSTOM_R_FLOAT << Mesh.ARRAY_FORMAT_CUSTOM2_SHIFT)
)


## Make the mesh of a scene. Its levels of detail consist of the same vertices, and therefore deform in the same way.
static func build(scene: Scene) -> ArrayMesh:
	var mesh := ImporterMesh.new()
	var coordinates_0 := _isoline_coordinate_columns(scene, 0)
	var coordinates_1 := _isoline_coordinate_columns(scene, 4)
	var numbers := PackedFloat32Array(range(scene.vertex_count))
	for part in drawn_parts(scene):
		var first: int = part["vertices"][0]
		var end: int = first + part["vertices"][1]
		var arrays := []
		arrays.resize(Mesh.ARRAY_MAX)
		arrays[Mesh.ARRAY_VERTEX] = scene.positions.slice(first, end)
		arrays[Mesh.ARRAY_NORMAL] = scene.normals.slice(first, end)
		arrays[Mesh.ARRAY_INDEX] = _clockwise(scene, part)
		if not scene.uv.is_empty():
			arrays[Mesh.ARRAY_TEX_UV] = scene.uv.slice(first, end)
			arrays[Mesh.ARRAY_TANGENT] = _tangents(arrays)
		arrays[Mesh.ARRAY_CUSTOM0] = coordinates_0.slice(4 * first, 4 * end)
		arrays[Mesh.ARRAY_CUSTOM1] = coordinates_1.slice(4 * first, 4 * end)
		arrays[Mesh.ARRAY_CUSTOM2] = numbers.slice(first, end)
		mesh.add_surface(Mesh.PRIMITIVE_TRIANGLES, arrays, [], {}, null, part["name"], _FORMAT)
	mesh.generate_lods(_LOD_MERGE_DEGREES, _LOD_SPLIT_DEGREES, [])
	return mesh.get_mesh()


## Return the parts with triangles, which become the surfaces of the mesh. If there are more than a mesh can have, the
## last surface contains all remaining parts.
static func drawn_parts(scene: Scene) -> Array[Dictionary]:
	var drawn: Array[Dictionary] = scene.parts.filter(
		func(part: Dictionary) -> bool: return part["vertices"][1] > 0 and part["triangles"][1] > 0
	)
	var most := RenderingServer.MAX_MESH_SURFACES
	if drawn.size() > most:
		var rest: Dictionary = drawn[most - 1].duplicate()
		for what: String in ["vertices", "triangles"]:
			var end: int = drawn[-1][what][0] + drawn[-1][what][1]
			rest[what] = [rest[what][0], end - rest[what][0]]
		drawn.resize(most - 1)
		drawn.append(rest)
	return drawn


## Make the texture of positions, normals, colours, and displacements by each target. Each begins in a new row.
static func rest_texture(scene: Scene) -> ImageTexture:
	var bytes := pad_rows(scene.positions.to_byte_array(), 12)
	bytes.append_array(pad_rows(scene.normals.to_byte_array(), 12))
	bytes.append_array(pad_rows(scene.colors.to_byte_array(), 12))
	for target in scene.displacement_count:
		var first := target * scene.vertex_count
		var displacements := scene.displacements.slice(first, first + scene.vertex_count)
		bytes.append_array(pad_rows(displacements.to_byte_array(), 12))
	return texture(bytes, Image.FORMAT_RGBF, 12)


## Make the texture of slopes: two per vertex and field.
static func slopes_texture(scene: Scene) -> ImageTexture:
	return texture(pad_rows(scene.slopes.to_byte_array(), 8), Image.FORMAT_RGF, 8)


## Return why the graphics card cannot evaluate the controls of a character; empty if it can.
static func obstacle(scene: Scene) -> String:
	if scene.field_count > MAX_FIELDS:
		return "it has %d fields, more than the maximum of %d" % [scene.field_count, MAX_FIELDS]
	if (
		rows(scene.vertex_count * scene.field_count) > MAX_TEXTURE_ROWS
		or (3 + scene.displacement_count) * rows(scene.vertex_count) > MAX_TEXTURE_ROWS
	):
		return "its %d vertices do not fit into a texture" % scene.vertex_count
	if scene.field_count * scene.isoline_count > MAX_TEXTURE_ROWS:
		return "its %d transforms do not fit into a texture" % (scene.field_count * scene.isoline_count)
	return ""


## Pad the last row of a texture with zeros.
static func pad_rows(bytes: PackedByteArray, texel: int) -> PackedByteArray:
	bytes.resize(rows(bytes.size() / texel) * _TEXTURE_WIDTH * texel)
	return bytes


static func texture(bytes: PackedByteArray, format: Image.Format, texel: int) -> ImageTexture:
	return ImageTexture.create_from_image(image(bytes, format, texel))


static func image(bytes: PackedByteArray, format: Image.Format, texel: int) -> Image:
	return Image.create_from_data(_TEXTURE_WIDTH, bytes.size() / (_TEXTURE_WIDTH * texel), false, format, bytes)


## Return the number of rows for a number of texels.
static func rows(texels: int) -> int:
	return (texels + _TEXTURE_WIDTH - 1) / _TEXTURE_WIDTH


## Return the isoline coordinates of four fields per vertex, zero for missing fields. They are cut out as columns of an
## image, which needs no loop in script.
static func _isoline_coordinate_columns(scene: Scene, first: int) -> PackedFloat32Array:
	var columns := Image.create_from_data(
		scene.field_count, scene.vertex_count, false, Image.FORMAT_RF, scene.isoline_coordinates.to_byte_array()
	)
	var wanted := clampi(scene.field_count - first, 0, 4)
	if wanted == 0:
		columns = Image.create(4, scene.vertex_count, false, Image.FORMAT_RF)
	else:
		columns = columns.get_region(Rect2i(first, 0, wanted, scene.vertex_count))
		columns.crop(4, scene.vertex_count)
	return columns.get_data().to_float32_array()


## Return the triangles of a part in clockwise order, as Godot requires. Indices of vertices outside of the part are
## clamped.
static func _clockwise(scene: Scene, part: Dictionary) -> PackedInt32Array:
	var first_vertex: int = part["vertices"][0]
	var last_vertex: int = part["vertices"][1] - 1
	var first: int = 3 * part["triangles"][0]
	var indices := scene.triangles.slice(first, first + 3 * part["triangles"][1])
	for corner in range(0, indices.size(), 3):
		var second := indices[corner + 1]
		indices[corner] = clampi(indices[corner] - first_vertex, 0, last_vertex)
		indices[corner + 1] = clampi(indices[corner + 2] - first_vertex, 0, last_vertex)
		indices[corner + 2] = clampi(second - first_vertex, 0, last_vertex)
	return indices


## Return the tangents that normal maps of custom materials require.
static func _tangents(arrays: Array) -> PackedFloat32Array:
	var tool := SurfaceTool.new()
	tool.create_from_arrays(arrays)
	tool.generate_tangents()
	return tool.commit_to_arrays()[Mesh.ARRAY_TANGENT]
