extends "teller.gd"
## Changes materials of characters of a running service, and reports the values that are drawn: PORT.

const SHADER := """
shader_type spatial;
#include "res://addons/puppetline/play/puppet.gdshaderinc"
uniform vec3 tint;
void vertex() {
	VERTEX = puppet_vertex(CUSTOM0, CUSTOM1, CUSTOM2, VERTEX, NORMAL, TANGENT, BINORMAL);
}
void fragment() {
	ALBEDO = tint;
}
"""


func start() -> void:
	var standard := StandardMaterial3D.new()
	var custom := ShaderMaterial.new()
	custom.shader = Shader.new()
	custom.shader.code = SHADER
	custom.set_shader_parameter(&"tint", Vector3.ONE)
	var puppets: Array[Puppet3D] = []
	for material: Material in [standard, custom]:
		var puppet := Puppet3D.new()
		puppet.port = int(arguments()[0])
		puppet.materials = [material]
		root.add_child(puppet)
		puppets.append(puppet)
	while puppets.any(func(puppet: Puppet3D) -> bool: return puppet.statistics()["sequence"] < 0):
		await process_frame
	var before := puppets.map(_drawn)
	standard.albedo_color = Color(0.25, 0.5, 0.75)
	standard.emission_enabled = true
	standard.emission = Color(1.0, 0.5, 0.25)
	custom.set_shader_parameter(&"tint", Vector3(0.5, 1.0, 0.0))
	for _frame in 3:
		await process_frame
	var now := puppets.map(_drawn)
	tell(_values(now[0], [&"albedo_color", &"emission"]).merged({"same": now[0] == before[0]}))
	tell(_values(now[1], [&"tint"]).merged({"same": now[1] == before[1]}))
	for puppet in puppets:
		puppet.free()
	quit()


func _drawn(puppet: Puppet3D) -> ShaderMaterial:
	var instance: MeshInstance3D = puppet.find_children("*", "MeshInstance3D", true, false)[-1]
	return instance.get_surface_override_material(0)


func _values(material: ShaderMaterial, names: Array[StringName]) -> Dictionary:
	var values := {}
	for name in names:
		values[name] = str(material.get_shader_parameter(name))
	return values
