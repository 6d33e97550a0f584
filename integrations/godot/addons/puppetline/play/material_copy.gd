extends RefCounted
## The copy of a material that deforms with a character. [method follow] passes on later changes of the original.
##
## Materials emit no signal when a property changes, so the values are compared.

const ShaderWriter := preload("shader_writer.gd")

## Unsupported features of standard materials, by the property that enables them.
const _UNSUPPORTED: Dictionary = {
	"heightmap_enabled": "height map",
	"refraction_enabled": "refraction",
	"detail_enabled": "detail",
	"subsurf_scatter_transmittance_enabled": "transmittance",
	"uv1_triplanar": "triplanar mapping",
	"uv2_triplanar": "triplanar mapping",
	"billboard_mode": "billboard",
	"proximity_fade_enabled": "proximity fade",
	"distance_fade_mode": "distance fade",
	"albedo_texture_msdf": "MSDF texture",
	"albedo_texture_force_srgb": "texture forced to sRGB",
	"use_point_size": "point size",
	"fixed_size": "fixed size",
}
## Beginning of the names of uniforms that the node sets.
const _OWN_UNIFORMS := "puppet_"

static var _shaders: Dictionary = {}  # code: WeakRef

## The copy; null if the material is a shader that does not deform.
var material: ShaderMaterial

var _original: Material
var _colored: bool
var _features: Array = []  # the values that have decided the shader
var _properties: Array[StringName] = []  # the uniforms that have values of the original
var _values: Array = []


## If [param colored], vertex colours come from the scene and not from the mesh.
func _init(original: Material, colored: bool) -> void:
	_original = original
	_colored = colored
	if original is ShaderMaterial and not _deforms(original.shader):
		_warn(
			"the shader of the material %s does not call puppet_vertex(), so its surface cannot move",
			"Include %s, which has instructions." % ShaderWriter.INCLUDE.resource_path
		)
		return
	material = ShaderMaterial.new()
	material.resource_name = original.resource_name
	_warn_of_unsupported()
	follow()


## Give the copy the values that the original has now.
func follow() -> void:
	material.render_priority = _original.render_priority
	if _original is ShaderMaterial:
		_follow_shader()
	else:
		_follow_features()
	for i in _properties.size():
		var value: Variant = _value(_properties[i])
		if not is_same(value, _values[i]):
			_values[i] = value
			material.set_shader_parameter(_properties[i], value)


func _follow_shader() -> void:
	var shader: Shader = _original.shader
	if shader == material.shader or not _deforms(shader):
		return
	material.shader = shader
	var names: Array[StringName] = []
	for uniform: Dictionary in shader.get_shader_uniform_list():
		if not uniform["name"].begins_with(_OWN_UNIFORMS):
			names.append(StringName(uniform["name"]))
	_set_properties(names)


func _follow_features() -> void:
	var features: Array = []
	for property in ShaderWriter.FEATURES:
		features.append(_original.get(property))
	if features == _features:
		return
	_features = features
	var writer := ShaderWriter.new(_original, _colored)
	material.shader = _shader(writer.code())
	_set_properties(writer.properties)


## Choose the uniforms to follow. They are compared with the present values of the copy, so that [method follow] sets
## those that differ.
func _set_properties(properties: Array[StringName]) -> void:
	_properties = properties
	_values.clear()
	for property in properties:
		_values.append(material.get_shader_parameter(property))


func _value(property: StringName) -> Variant:
	return _original.get_shader_parameter(property) if _original is ShaderMaterial else _original.get(property)


func _warn_of_unsupported() -> void:
	var unsupported := PackedStringArray()
	for property: String in _UNSUPPORTED if _original is BaseMaterial3D else {}:
		if _original.get(property):
			unsupported.append(_UNSUPPORTED[property])
	if not unsupported.is_empty():
		_warn("the material %s is drawn without: " + ", ".join(unsupported))


func _warn(found: String, fix := "") -> void:
	var name := _original.resource_name if _original.resource_name else _original.resource_path
	push_warning(("Puppetline: %s. %s" % [found % name, fix]).strip_edges())


static func _deforms(shader: Shader) -> bool:
	return shader != null and shader.code.contains("puppet_vertex")


static func _shader(code: String) -> Shader:
	var shader: Shader = _shaders[code].get_ref() if code in _shaders else null
	if shader == null:
		shader = Shader.new()
		shader.code = code
		_shaders[code] = weakref(shader)
	return shader
