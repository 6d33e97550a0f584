extends "photographer.gd"
## Draws a character with many materials, once with Godot's own material and once with the addon's version of it. The
## first argument is a FOLDER with scene.bin, rest.bin, bent.bin, vertices.bin and vertices16.bin (payloads: scene,
## controls at rest and bent, vertices of the latter), which also receives the images. With the path of an imported
## scene as second argument, only that scene is drawn, as imported and by the addon. With "bent", only the bent
## character is drawn.

const TEXTURES: Array[StringName] = [
	&"albedo_texture",
	&"metallic_texture",
	&"roughness_texture",
	&"normal_texture",
	&"ao_texture",
	&"emission_texture",
	&"orm_texture",
	&"rim_texture",
	&"clearcoat_texture",
	&"backlight_texture",
	&"anisotropy_flowmap",
]
## Names and values of properties; a texture is given by the name of its contents.
const CASES: Dictionary = {
	"plain": {},
	"color": {"albedo_color": Color(0.8, 0.3, 0.1), "metallic": 0.4, "roughness": 0.35, "metallic_specular": 0.8},
	"texture": {"albedo_texture": "picture"},
	"nearest": {"albedo_texture": "picture", "texture_filter": BaseMaterial3D.TEXTURE_FILTER_NEAREST},
	"mapping":
	{
		"albedo_texture": "picture",
		"uv1_scale": Vector3(7, 5, 1),
		"uv1_offset": Vector3(0.3, -0.2, 0),
		"texture_filter": BaseMaterial3D.TEXTURE_FILTER_LINEAR_WITH_MIPMAPS_ANISOTROPIC,
	},
	"clamped": {"albedo_texture": "picture", "uv1_scale": Vector3(4, 4, 1), "texture_repeat": false},
	"metal":
	{
		"metallic": 0.9,
		"metallic_texture": "picture",
		"metallic_texture_channel": BaseMaterial3D.TEXTURE_CHANNEL_BLUE,
		"roughness": 0.8,
		"roughness_texture": "picture",
		"roughness_texture_channel": BaseMaterial3D.TEXTURE_CHANNEL_GREEN,
	},
	"gray": {"roughness_texture": "picture", "roughness_texture_channel": BaseMaterial3D.TEXTURE_CHANNEL_GRAYSCALE},
	"normal": {"normal_enabled": true, "normal_texture": "bumps", "normal_scale": 1.5, "uv1_scale": Vector3(5, 5, 1)},
	"occlusion":
	{
		"ao_enabled": true,
		"ao_texture": "picture",
		"ao_light_affect": 0.7,
		"ao_texture_channel": BaseMaterial3D.TEXTURE_CHANNEL_GREEN,
	},
	"emission": {"emission_enabled": true, "emission": Color(0.1, 0.3, 0.2), "emission_texture": "picture"},
	"glow":
	{
		"emission_enabled": true,
		"emission": Color(0.5, 0.9, 0.2),
		"emission_energy_multiplier": 2.0,
		"emission_texture": "picture",
		"emission_operator": BaseMaterial3D.EMISSION_OP_MULTIPLY,
	},
	"scissor":
	{
		"albedo_texture": "picture",
		"transparency": BaseMaterial3D.TRANSPARENCY_ALPHA_SCISSOR,
		"alpha_scissor_threshold": 0.6,
		"cull_mode": BaseMaterial3D.CULL_DISABLED,
	},
	"blend":
	{
		"albedo_texture": "picture",
		"albedo_color": Color(1, 1, 1, 0.7),
		"transparency": BaseMaterial3D.TRANSPARENCY_ALPHA,
	},
	"prepass": {"albedo_texture": "picture", "transparency": BaseMaterial3D.TRANSPARENCY_ALPHA_DEPTH_PRE_PASS},
	"added":
	{
		"albedo_texture": "picture",
		"transparency": BaseMaterial3D.TRANSPARENCY_ALPHA,
		"blend_mode": BaseMaterial3D.BLEND_MODE_ADD,
	},
	"inside":
	{"cull_mode": BaseMaterial3D.CULL_FRONT, "disable_receive_shadows": true, "albedo_color": Color(0.5, 0.6, 1.0)},
	"unshaded": {"albedo_texture": "picture", "shading_mode": BaseMaterial3D.SHADING_MODE_UNSHADED},
	"per vertex": {"albedo_texture": "picture", "shading_mode": BaseMaterial3D.SHADING_MODE_PER_VERTEX},
	"toon":
	{
		"diffuse_mode": BaseMaterial3D.DIFFUSE_TOON,
		"specular_mode": BaseMaterial3D.SPECULAR_TOON,
		"disable_receive_shadows": true,
	},
	"dark": {"disable_ambient_light": true, "specular_mode": BaseMaterial3D.SPECULAR_DISABLED},
	"rim": {"rim_enabled": true, "rim": 0.9, "rim_tint": 0.3, "rim_texture": "picture"},
	"coat": {"clearcoat_enabled": true, "clearcoat": 0.9, "clearcoat_roughness": 0.2, "clearcoat_texture": "picture"},
	"backlight": {"backlight_enabled": true, "backlight": Color(0.4, 0.1, 0.1), "backlight_texture": "picture"},
	"anisotropy": {"anisotropy_enabled": true, "anisotropy": 0.8, "roughness": 0.3, "anisotropy_flowmap": "picture"},
	"grown": {"grow": true, "grow_amount": 0.1},
	"orm": {"orm_texture": "picture", "ao_enabled": true, "ao_light_affect": 0.5, "albedo_color": Color(0.9, 0.8, 0.3)},
	"colors": {"vertex_color_use_as_albedo": true},
}

const USERS_SHADER := """
shader_type spatial;
render_mode diffuse_burley, specular_schlick_ggx;
#include "res://addons/puppetline/play/puppet.gdshaderinc"
uniform vec4 tint : source_color;

void vertex() {
	VERTEX = puppet_vertex(CUSTOM0, CUSTOM1, CUSTOM2, VERTEX, NORMAL, TANGENT, BINORMAL);
}

void fragment() {
	ALBEDO = tint.rgb;
}
"""

var _textures: Dictionary = {}


func start() -> void:
	open(arguments()[0])
	_textures = {"picture": _picture(), "bumps": _bumps()}
	make_stage()
	if arguments().size() == 1:
		for case: String in CASES:
			await _draw(case)
		await _draw_bent()
		await _draw_users()
	elif arguments()[1] == "bent":
		await _draw_bent()
	else:
		await _draw_imported(load(arguments()[1]))
	resources = null
	quit()


func _draw(case: String) -> void:
	var material := _material(CASES[case], case == "orm")
	var own := MeshInstance3D.new()
	own.mesh = mesh_of(resources.scene.positions, resources.scene.normals)
	own.material_override = material
	await photograph(own, "%s own" % case)
	await photograph(shown(ControlsBody.new(resources, null), "rest", material), "%s made" % case)
	tell({"case": case})


func _draw_bent() -> void:
	var material := _material(CASES["mapping"], false)
	var own := MeshInstance3D.new()
	own.mesh = bent_mesh()
	own.material_override = material
	await photograph(own, "bent own")
	await photograph(shown(ControlsBody.new(resources, null), "bent", material), "bent made")
	await photograph(shown(VerticesBody.new(resources), "vertices16", material), "bent vertices")
	tell({"case": "bent"})


func _draw_users() -> void:
	var own := MeshInstance3D.new()
	own.mesh = bent_mesh()
	own.material_override = StandardMaterial3D.new()
	own.material_override.albedo_color = Color(0.8, 0.5, 0.2)
	await photograph(own, "user's own")
	await photograph(shown(ControlsBody.new(resources, null), "bent", _users_material()), "user's made")
	tell({"case": "user's"})


func _draw_imported(scene: PackedScene) -> void:
	await photograph(scene.instantiate(), "imported own")
	await photograph(shown(ControlsBody.new(resources, scene.instantiate()), "rest", null), "imported made")
	tell({"case": "imported"})


func _material(properties: Dictionary, orm: bool) -> BaseMaterial3D:
	var material: BaseMaterial3D = ORMMaterial3D.new() if orm else StandardMaterial3D.new()
	for property: StringName in properties:
		var value: Variant = properties[property]
		material.set(property, _textures[value] if property in TEXTURES else value)
	return material


func _users_material() -> ShaderMaterial:
	var material := ShaderMaterial.new()
	material.shader = Shader.new()
	material.shader.code = USERS_SHADER
	material.set_shader_parameter(&"tint", Color(0.8, 0.5, 0.2))
	return material


## Return an image with different channels and with holes.
func _picture() -> ImageTexture:
	var image := Image.create(64, 64, false, Image.FORMAT_RGBA8)
	for x in 64:
		for y in 64:
			image.set_pixel(x, y, Color(x / 63.0, y / 63.0, 0.5 + 0.5 * sin(x * 0.7), 0.5 + 0.5 * cos(y * 0.4)))
	image.generate_mipmaps()
	return ImageTexture.create_from_image(image)


func _bumps() -> ImageTexture:
	var image := Image.create(64, 64, false, Image.FORMAT_RGB8)
	for x in 64:
		for y in 64:
			var normal := Vector3(0.6 * sin(x * TAU / 16), 0.6 * cos(y * TAU / 32), 1.0).normalized()
			image.set_pixel(x, y, Color(0.5 * normal.x + 0.5, 0.5 * normal.y + 0.5, 0.5 * normal.z + 0.5))
	image.generate_mipmaps()
	return ImageTexture.create_from_image(image)
