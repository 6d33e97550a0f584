extends RefCounted
## Writer of the shader that reproduces the look of one standard material and deforms it.
##
## Scripts cannot read the shaders of Godot's standard materials. This script writes them for the features of glTF and
## other common ones. Each uniform has the name of the property that provides its value.

## The include file of the shaders; preloading it also adds it to exported games.
const INCLUDE := preload("puppet.gdshaderinc")
## The properties of a standard material that decide the code of its shader, besides the textures' channels.
const FEATURES: Array[StringName] = [
	&"texture_filter",
	&"texture_repeat",
	&"blend_mode",
	&"depth_draw_mode",
	&"cull_mode",
	&"diffuse_mode",
	&"specular_mode",
	&"shading_mode",
	&"no_depth_test",
	&"disable_receive_shadows",
	&"disable_ambient_light",
	&"disable_fog",
	&"shadow_to_opacity",
	&"transparency",
	&"subsurf_scatter_enabled",
	&"subsurf_scatter_skin_mode",
	&"vertex_color_is_srgb",
	&"vertex_color_use_as_albedo",
	&"grow",
	&"ao_enabled",
	&"ao_on_uv2",
	&"ao_texture_channel",
	&"metallic_texture_channel",
	&"roughness_texture_channel",
	&"normal_enabled",
	&"emission_enabled",
	&"emission_operator",
	&"emission_on_uv2",
	&"rim_enabled",
	&"clearcoat_enabled",
	&"anisotropy_enabled",
	&"backlight_enabled",
]

const _FILTERS: Array[String] = [
	"filter_nearest",
	"filter_linear",
	"filter_nearest_mipmap",
	"filter_linear_mipmap",
	"filter_nearest_mipmap_anisotropic",
	"filter_linear_mipmap_anisotropic",
]
const _BLENDS: Array[String] = ["blend_mix", "blend_add", "blend_sub", "blend_mul", "blend_premul_alpha"]
const _DEPTHS: Array[String] = ["depth_draw_opaque", "depth_draw_always", "depth_draw_never"]
const _CULLS: Array[String] = ["cull_back", "cull_front", "cull_disabled"]
const _DIFFUSES: Array[String] = ["diffuse_burley", "diffuse_lambert", "diffuse_lambert_wrap", "diffuse_toon"]
const _SPECULARS: Array[String] = ["specular_schlick_ggx", "specular_toon", "specular_disabled"]
const _CHANNELS: Array[String] = [
	"vec4(1.0, 0.0, 0.0, 0.0)",
	"vec4(0.0, 1.0, 0.0, 0.0)",
	"vec4(0.0, 0.0, 1.0, 0.0)",
	"vec4(0.0, 0.0, 0.0, 1.0)",
	"vec4(0.333333, 0.333333, 0.333333, 0.0)",
]
const _ROUGHNESS_HINTS: Array[String] = [
	"hint_roughness_r", "hint_roughness_g", "hint_roughness_b", "hint_roughness_a", "hint_roughness_gray"
]

## The properties that provide the values of uniforms with the same names.
var properties: Array[StringName] = []

var _material: BaseMaterial3D
var _sampling := ""
var _modes: Array[String] = []
var _uniforms: Array[String] = []
var _vertex: Array[String] = []
var _fragment: Array[String] = []


func _init(material: BaseMaterial3D, colored: bool) -> void:
	_material = material
	_sampling = (
		"%s, %s" % [_FILTERS[material.texture_filter], "repeat_enable" if material.texture_repeat else "repeat_disable"]
	)
	_write_modes()
	_write_vertex(colored)
	_write_color()
	_write_surface()
	_write_extras()
	_write_transparency()


func code() -> String:
	return (
		'shader_type spatial;\nrender_mode %s;\n#include "%s"\n%s\nvoid vertex() {\n\t%s\n}\nvoid fragment() {\n\t%s\n}\n'
		% [
			", ".join(_modes),
			INCLUDE.resource_path,
			"\n".join(_uniforms),
			"\n\t".join(_vertex),
			"\n\t".join(_fragment),
		]
	)


func _uniform(type: String, property: StringName, hint := "") -> void:
	properties.append(property)
	_uniforms.append("uniform %s %s%s;" % [type, property, " : " + hint if hint else ""])


func _sampler(property: StringName, hint: String) -> void:
	_uniform("sampler2D", property, "%s, %s" % [hint, _sampling])


func _write_modes() -> void:
	var m := _material
	_modes = [
		_BLENDS[m.blend_mode],
		_DEPTHS[m.depth_draw_mode],
		_CULLS[m.cull_mode],
		_DIFFUSES[m.diffuse_mode],
		_SPECULARS[m.specular_mode],
	]
	var more := {
		"unshaded": m.shading_mode == BaseMaterial3D.SHADING_MODE_UNSHADED,
		"vertex_lighting": m.shading_mode == BaseMaterial3D.SHADING_MODE_PER_VERTEX,
		"depth_test_disabled": m.no_depth_test,
		"shadows_disabled": m.disable_receive_shadows,
		"ambient_light_disabled": m.disable_ambient_light,
		"fog_disabled": m.disable_fog,
		"shadow_to_opacity": m.shadow_to_opacity,
		"depth_prepass_alpha": m.transparency == BaseMaterial3D.TRANSPARENCY_ALPHA_DEPTH_PRE_PASS,
		"sss_mode_skin": m.subsurf_scatter_enabled and m.subsurf_scatter_skin_mode,
	}
	_modes.append_array(more.keys().filter(func(mode: String) -> bool: return more[mode]))


func _write_vertex(colored: bool) -> void:
	_uniform("vec3", &"uv1_scale")
	_uniform("vec3", &"uv1_offset")
	_vertex.append("VERTEX = puppet_vertex(CUSTOM0, CUSTOM1, CUSTOM2, VERTEX, NORMAL, TANGENT, BINORMAL);")
	_vertex.append("UV = UV * uv1_scale.xy + uv1_offset.xy;")
	if colored:
		_vertex.append("COLOR.rgb = puppet_color(CUSTOM2);")
	elif _material.vertex_color_is_srgb:
		_vertex.append("if (!OUTPUT_IS_SRGB) {")
		_vertex.append("\tvec3 power = pow((COLOR.rgb + vec3(0.055)) / 1.055, vec3(2.4));")
		_vertex.append("\tCOLOR.rgb = mix(power, COLOR.rgb / 12.92, lessThan(COLOR.rgb, vec3(0.04045)));")
		_vertex.append("}")
	if _material.shading_mode == BaseMaterial3D.SHADING_MODE_PER_VERTEX:
		_vertex.append("ROUGHNESS = %s;" % ("1.0" if _material is ORMMaterial3D else "roughness"))
	if _material.grow:
		_uniform("float", &"grow_amount")
		_vertex.append("VERTEX += NORMAL * grow_amount;")


func _write_color() -> void:
	_uniform("vec4", &"albedo_color", "source_color")
	_sampler(&"albedo_texture", "source_color")
	_fragment.append("vec4 base = albedo_color * texture(albedo_texture, UV);")
	if _material.vertex_color_use_as_albedo:
		_fragment.append("base *= COLOR;")
	_fragment.append("ALBEDO = base.rgb;")


func _write_surface() -> void:
	if _material is ORMMaterial3D:
		_sampler(&"orm_texture", "hint_roughness_g")
		_fragment.append("vec4 orm = texture(orm_texture, UV);")
		_fragment.append("ROUGHNESS = orm.g;")
		_fragment.append("METALLIC = orm.b;")
		if _material.ao_enabled:
			_uniform("float", &"ao_light_affect")
			_fragment.append("AO = orm.r;")
			_fragment.append("AO_LIGHT_AFFECT = ao_light_affect;")
		return
	_uniform("float", &"metallic")
	_uniform("float", &"metallic_specular")
	_uniform("float", &"roughness")
	_sampler(&"metallic_texture", "hint_default_white")
	_sampler(&"roughness_texture", _ROUGHNESS_HINTS[_material.roughness_texture_channel])
	_fragment.append("METALLIC = metallic * %s;" % _channel(&"metallic_texture", "UV"))
	_fragment.append("ROUGHNESS = roughness * %s;" % _channel(&"roughness_texture", "UV"))
	_fragment.append("SPECULAR = metallic_specular;")
	if _material.ao_enabled:
		_uniform("float", &"ao_light_affect")
		_sampler(&"ao_texture", "hint_default_white")
		_fragment.append("AO = %s;" % _channel(&"ao_texture", "UV2" if _material.ao_on_uv2 else "UV"))
		_fragment.append("AO_LIGHT_AFFECT = ao_light_affect;")


func _write_extras() -> void:
	if _material.normal_enabled:
		_uniform("float", &"normal_scale")
		_sampler(&"normal_texture", "hint_roughness_normal")
		_fragment.append("NORMAL_MAP = texture(normal_texture, UV).rgb;")
		_fragment.append("NORMAL_MAP_DEPTH = normal_scale;")
	if _material.emission_enabled:
		_uniform("vec4", &"emission", "source_color")
		_uniform("float", &"emission_energy_multiplier")
		_sampler(&"emission_texture", "source_color, hint_default_black")
		var operator := "+" if _material.emission_operator == BaseMaterial3D.EMISSION_OP_ADD else "*"
		var light := "texture(emission_texture, %s).rgb" % ("UV2" if _material.emission_on_uv2 else "UV")
		_fragment.append("EMISSION = (emission.rgb %s %s) * emission_energy_multiplier;" % [operator, light])
	if _material.rim_enabled:
		_uniform("float", &"rim")
		_uniform("float", &"rim_tint")
		_sampler(&"rim_texture", "hint_default_white")
		_fragment.append("RIM = rim * texture(rim_texture, UV).x;")
		_fragment.append("RIM_TINT = rim_tint * texture(rim_texture, UV).y;")
	if _material.clearcoat_enabled:
		_uniform("float", &"clearcoat")
		_uniform("float", &"clearcoat_roughness")
		_sampler(&"clearcoat_texture", "hint_default_white")
		_fragment.append("CLEARCOAT = clearcoat * texture(clearcoat_texture, UV).x;")
		_fragment.append("CLEARCOAT_ROUGHNESS = clearcoat_roughness * texture(clearcoat_texture, UV).y;")
	if _material.anisotropy_enabled:
		_uniform("float", &"anisotropy")
		_sampler(&"anisotropy_flowmap", "hint_anisotropy")
		_fragment.append("ANISOTROPY = anisotropy * texture(anisotropy_flowmap, UV).a;")
		_fragment.append("ANISOTROPY_FLOW = texture(anisotropy_flowmap, UV).rg * 2.0 - 1.0;")
	if _material.subsurf_scatter_enabled:
		_uniform("float", &"subsurf_scatter_strength")
		_sampler(&"subsurf_scatter_texture", "hint_default_white")
		_fragment.append("SSS_STRENGTH = subsurf_scatter_strength * texture(subsurf_scatter_texture, UV).r;")
	if _material.backlight_enabled:
		_uniform("vec4", &"backlight", "source_color")
		_sampler(&"backlight_texture", "hint_default_black")
		_fragment.append("BACKLIGHT = backlight.rgb + texture(backlight_texture, UV).rgb;")


func _write_transparency() -> void:
	if _material.transparency == BaseMaterial3D.TRANSPARENCY_DISABLED and not _material.shadow_to_opacity:
		return
	_fragment.append("ALPHA *= base.a;")
	if _material.transparency == BaseMaterial3D.TRANSPARENCY_ALPHA_SCISSOR:
		_uniform("float", &"alpha_scissor_threshold")
		_fragment.append("ALPHA_SCISSOR_THRESHOLD = alpha_scissor_threshold;")
	elif _material.transparency == BaseMaterial3D.TRANSPARENCY_ALPHA_HASH:
		_uniform("float", &"alpha_hash_scale")
		_fragment.append("ALPHA_HASH_SCALE = alpha_hash_scale;")


func _channel(texture: StringName, uv: String) -> String:
	var channel: int = _material.get("%s_channel" % texture)
	return "dot(texture(%s, %s), %s)" % [texture, uv, _CHANNELS[channel]]
