extends RefCounted
## Names of humanoid bones in common rigs, and the joints of the service that they are: Godot's SkeletonProfileHumanoid,
## VRM, Mixamo, Unreal, Rigify and others.

const _MIDDLE: Dictionary = {
	"hips": ["hips", "hip", "pelvis"],
	"spine": ["spine", "spine01", "abdomen"],
	"chest": ["chest", "spine1", "spine02", "torso"],
	"upperChest": ["upperchest", "spine2", "spine03"],
	"neck": ["neck", "neck01"],
	"head": ["head"],
}
const _SIDED: Dictionary = {
	"Shoulder": ["shoulder", "clavicle"],
	"UpperArm": ["upperarm", "arm"],
	"LowerArm": ["lowerarm", "forearm"],
	"Hand": ["hand", "wrist"],
	"UpperLeg": ["upperleg", "upleg", "thigh"],
	"LowerLeg": ["lowerleg", "leg", "shin", "calf"],
	"Foot": ["foot"],
	"Toes": ["toes", "toe", "toebase", "ball"],
}
const _PREFIX := "^(mixamorig\\d*[:_]|J_Bip_[CLR]_|DEF[-_]|.*:)"
const _SIDE := "^(left|right)[ ._-]?|^([lr])[ ._-]|[ ._-]([lr]|left|right)$"


## Return the bone of a skeleton for each of these joints that it has, by name. The [param edits], bones by joint, come
## first; an empty bone leaves a joint out.
static func bones_of(skeleton: Skeleton3D, joints: Array, edits: Dictionary) -> Dictionary:
	var found := {}
	for bone in skeleton.get_bone_count():
		var name := skeleton.get_bone_name(bone)
		var joint: String = name if name in joints else recognised(name)
		if joint in joints and joint not in edits and joint not in found:
			found[joint] = bone
	for joint: Variant in edits:
		var bone := skeleton.find_bone(str(edits[joint]))
		if str(joint) in joints and bone >= 0:
			found[str(joint)] = bone
	return found


## Return the joint of a humanoid that a bone's name means; empty if it is not known.
static func recognised(bone: String) -> String:
	var prefix := RegEx.create_from_string(_PREFIX).search(bone)
	var rest := bone.substr(prefix.get_end() if prefix != null else 0).to_lower()
	var side := RegEx.create_from_string(_SIDE).search(rest)
	var word := ""
	if prefix != null and prefix.get_string().begins_with("J_Bip_"):
		word = {"L": "left", "R": "right"}.get(prefix.get_string()[6], "")
	elif side != null:
		word = "left" if side.get_string().lstrip(" ._-").begins_with("l") else "right"
		rest = rest.substr(0, side.get_start()) + rest.substr(side.get_end())
	rest = RegEx.create_from_string("[^a-z0-9]").sub(rest, "", true)
	var names: Dictionary = _SIDED if word else _MIDDLE
	for joint: String in names:
		if rest in names[joint]:
			return word + joint
	return ""
