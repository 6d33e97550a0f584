extends Node3D
## Base of [Puppet3D]: the rendering properties that the node passes on to the meshes that show its character.

const OwnMesh := preload("own_mesh.gd")

## The properties below, which [GeometryInstance3D] and [VisualInstance3D] have under the same names.
const _NAMES: Array[StringName] = [
	&"layers",
	&"cast_shadow",
	&"gi_mode",
	&"lod_bias",
	&"visibility_range_begin",
	&"visibility_range_begin_margin",
	&"visibility_range_end",
	&"visibility_range_end_margin",
	&"visibility_range_fade_mode",
]

@export_group("Rendering")
## Render layers of the character's meshes. These properties replace those of the meshes in [member mesh_source].
@export_flags_3d_render var layers := 1:
	set(value):
		layers = value
		pass_on_rendering()
## Whether the character casts shadows.
@export var cast_shadow := GeometryInstance3D.SHADOW_CASTING_SETTING_ON:
	set(value):
		cast_shadow = value
		pass_on_rendering()
## How global illumination treats the character.
@export var gi_mode := GeometryInstance3D.GI_MODE_DYNAMIC:
	set(value):
		gi_mode = value
		pass_on_rendering()
## Factor of the distance up to which a level of detail is used: more than 1 keeps more triangles.
@export_range(0.001, 128.0, 0.001) var lod_bias := 1.0:
	set(value):
		lod_bias = value
		pass_on_rendering()
## Distance from the camera at which the character appears; 0 for no limit.
@export_range(0.0, 4096.0, 0.01, "or_greater", "suffix:m") var visibility_range_begin := 0.0:
	set(value):
		visibility_range_begin = value
		pass_on_rendering()
## Width of the fade, or of the hysteresis, at [member visibility_range_begin].
@export_range(0.0, 4096.0, 0.01, "or_greater", "suffix:m") var visibility_range_begin_margin := 0.0:
	set(value):
		visibility_range_begin_margin = value
		pass_on_rendering()
## Distance from the camera at which the character disappears; 0 for no limit.
@export_range(0.0, 4096.0, 0.01, "or_greater", "suffix:m") var visibility_range_end := 0.0:
	set(value):
		visibility_range_end = value
		pass_on_rendering()
## Width of the fade, or of the hysteresis, at [member visibility_range_end].
@export_range(0.0, 4096.0, 0.01, "or_greater", "suffix:m") var visibility_range_end_margin := 0.0:
	set(value):
		visibility_range_end_margin = value
		pass_on_rendering()
## Whether the character fades within the margins (Forward+ only).
@export var visibility_range_fade_mode := GeometryInstance3D.VISIBILITY_RANGE_FADE_DISABLED:
	set(value):
		visibility_range_fade_mode = value
		pass_on_rendering()


## Give the meshes of all nodes that show the character the properties of this node.
func pass_on_rendering() -> void:
	for node in _shown_nodes():
		for instance in OwnMesh.meshes_below(node):
			for name in _NAMES:
				instance.set(name, get(name))


## Return the nodes that show the character.
func _shown_nodes() -> Array[Node3D]:
	return []
