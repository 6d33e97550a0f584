extends "photographer.gd"
## Draws the bent characters of folders, three images each: the normals that the graphics card computes, a mesh of the
## bent vertices with Godot's own material, and the addon's version of it. Arguments: the beginning of the images'
## names, FOLDER...

const Materials := preload("res://addons/puppetline/play/materials.gd")

const NORMALS_SHADER := """
shader_type spatial;
render_mode unshaded;
#include "res://addons/puppetline/play/puppet.gdshaderinc"
varying vec3 direction;

void vertex() {
	VERTEX = puppet_vertex(CUSTOM0, CUSTOM1, CUSTOM2, VERTEX, NORMAL, TANGENT, BINORMAL);
	direction = NORMAL;
}

void fragment() {
	ALBEDO = 0.5 + 0.5 * normalize(direction);
}
"""


func start() -> void:
	for path in arguments().slice(1):
		open(path)
		make_stage()
		await _draw(arguments()[0])
		stage.free()
		shared = null
	quit()


func _draw(beginning: String) -> void:
	var normals := ShaderMaterial.new()
	normals.shader = Shader.new()
	normals.shader.code = NORMALS_SHADER
	await photograph(shown(ControlsBody.new(shared, null), "bent", normals), beginning + " normals")
	var own := MeshInstance3D.new()
	own.mesh = bent_mesh()
	own.material_override = Materials.of_scene(shared.scene)[0]
	await photograph(own, beginning + " own")
	await photograph(shown(ControlsBody.new(shared, null), "bent", null), beginning + " made")
	tell({"folder": folder})
