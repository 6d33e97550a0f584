extends RefCounted
## The rendering properties that a Puppet3D passes on to the meshes that show its character.

const OwnMesh := preload("own_mesh.gd")

## Properties that the node shares with [GeometryInstance3D] and [VisualInstance3D].
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


## Give all meshes below a node the properties of a Puppet3D.
static func pass_on(puppet: Node3D, below: Node) -> void:
	for instance in OwnMesh.meshes_below(below):
		for name in _NAMES:
			instance.set(name, puppet.get(name))
