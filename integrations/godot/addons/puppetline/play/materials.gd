extends RefCounted
## The materials of a character: those of a scene, and the copies that deform.

const RestMesh := preload("rest_mesh.gd")
const Scene := preload("../wire/scene.gd")
const SceneResources := preload("scene_resources.gd")
const MaterialCopy := preload("material_copy.gd")


## Return the standard material of a part of a scene, equal to the one from Godot's importer. If [param colored], the
## scene has vertex colours, which replace the base colour except for its opacity.
static func of_part(description: Dictionary, colored: bool) -> StandardMaterial3D:
	var material := StandardMaterial3D.new()
	var base: Array = description["base_color"]
	var emissive: Array = description["emissive"]
	material.resource_name = description["name"]
	material.albedo_color = Color(base[0], base[1], base[2], base[3]).linear_to_srgb()
	if colored:
		material.albedo_color = Color(Color.WHITE, base[3])
	material.vertex_color_use_as_albedo = colored
	material.metallic = description["metallic"]
	material.roughness = description["roughness"]
	material.emission = Color(emissive[0], emissive[1], emissive[2]).linear_to_srgb()
	material.emission_enabled = material.emission != Color.BLACK
	if description["double_sided"]:
		material.cull_mode = BaseMaterial3D.CULL_DISABLED
	match description["alpha_mode"]:
		"BLEND":
			material.transparency = BaseMaterial3D.TRANSPARENCY_ALPHA_DEPTH_PRE_PASS
		"MASK":
			material.transparency = BaseMaterial3D.TRANSPARENCY_ALPHA_SCISSOR
	return material


## Return the standard material of each surface of a scene.
static func of_scene(scene: Scene) -> Array[Material]:
	var materials: Array[Material] = []
	for part in RestMesh.drawn_parts(scene):
		materials.append(of_part(part["material"], not scene.colors.is_empty()))
	return materials


## Return the deforming copies of a material and of its next passes; empty if the material cannot deform. If [param
## colored], vertex colours come from the scene and not from the mesh.
static func moving(material: Material, colored: bool) -> Array[MaterialCopy]:
	var copies: Array[MaterialCopy] = []
	while material != null:
		var copy := MaterialCopy.new(material, colored)
		if copy.material == null:
			break
		if not copies.is_empty():
			copies[-1].material.next_pass = copy.material
		copies.append(copy)
		material = material.next_pass
	return copies


## Set the uniforms that are the same in all frames.
static func prepare(material: ShaderMaterial, resources: SceneResources) -> void:
	var scene := resources.scene
	var weights := scene.weights.duplicate()
	weights.resize(8)
	material.set_shader_parameter(&"puppet_rest", resources.rest_texture)
	var rows := RestMesh.rows(scene.vertex_count)
	material.set_shader_parameter(&"puppet_rest_rows", rows)
	material.set_shader_parameter(&"puppet_displacements_row", rows * (2 if scene.colors.is_empty() else 3))
	material.set_shader_parameter(&"puppet_targets", scene.displacement_count)
	material.set_shader_parameter(&"puppet_slopes", resources.slopes_texture)
	material.set_shader_parameter(&"puppet_fields", scene.field_count)
	material.set_shader_parameter(&"puppet_isolines", scene.isoline_count)
	material.set_shader_parameter(&"puppet_weights_0", Vector4(weights[0], weights[1], weights[2], weights[3]))
	material.set_shader_parameter(&"puppet_weights_1", Vector4(weights[4], weights[5], weights[6], weights[7]))
