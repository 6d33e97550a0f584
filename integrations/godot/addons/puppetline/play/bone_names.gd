extends RefCounted
## Recognises the bones of a humanoid by their names in other programs: Godot's SkeletonProfileHumanoid, VRM, VRoid,
## Mixamo, Unreal, Rigify, Character Creator, SMPL and others, and common English names, with a side in any spelling.

const _MIDDLE: Dictionary = {
	"hips": ["hips", "pelvis", "hip"],
	"spine": ["spine", "spine1st", "spine01", "abdomen", "ab", "waist"],
	"chest": ["chest", "spine1", "spine02", "torso", "spine001"],
	"upperChest": ["upperchest", "spine2", "spine03", "spine002"],
	"neck": ["neck", "neck01", "neck1", "necktwist01", "spine004"],
	"head": ["head", "spine006"],
}
const _SIDED: Dictionary = {
	"Shoulder": ["shoulder", "clavicle", "collar", "scapula", "shoulder1"],
	"UpperArm": ["upperarm", "arm", "armupper", "uparm", "shldr"],
	"LowerArm": ["lowerarm", "forearm", "elbow", "armlower", "lowarm"],
	"Hand": ["hand", "wrist"],
	"UpperLeg": ["upperleg", "upleg", "thigh", "legupper", "hip"],
	"LowerLeg": ["lowerleg", "leg", "shin", "calf", "knee", "leglower", "lowleg"],
	"Foot": ["foot", "ankle"],
	"Toes": ["toes", "toebase", "toe", "toe0", "ball"],
}
## A finger's joint, by its part or by its number from the palm.
const _FINGER := (
	"^(?:hand|f)?(thumb|index|middle|ring|little|pink[a-z]+)(?:finger)?"
	+ "(?:0*([123])|(metacarpal|proximal|intermediate|distal))$"
)
## Words that programs put before or after a bone's own name.
const _DECORATION: Array[String] = [
	"def", "org", "mixamorig", "bip01", "bip001", "j", "bip", "c", "m", "cc", "base", "joint", "valvebiped"
]


## Return the bone of a skeleton for each joint of a service that is recognised, by the joint's name.
##
## Where programs call an upper arm "shoulder", a collar bone is before it.
static func recognised(skeleton: Skeleton3D, joints: PackedStringArray) -> Dictionary:
	var found: Dictionary = {}
	var by_meaning: Dictionary = {}
	var last: Dictionary = {}
	for bone in skeleton.get_bone_count():
		var own := skeleton.get_bone_name(bone)
		if own in joints:
			found[own] = own
		var meaning := meaning_of(own)
		if meaning and not meaning in by_meaning:
			by_meaning[meaning] = own
		elif meaning.ends_with("Shoulder"):
			last[meaning.replace("Shoulder", "UpperArm")] = own
	by_meaning.merge(last)
	for joint in joints:
		if joint not in found and joint in by_meaning and not by_meaning[joint] in found.values():
			found[joint] = by_meaning[joint]
	return found


## Return VRM's name for the name of a bone; empty if it is unknown.
static func meaning_of(bone: String) -> String:
	var words := PackedStringArray()
	for word in _words(bone):
		if word not in _DECORATION:
			words.append(word)
	var side := ""
	var left := PackedStringArray()
	for word in words:
		if word in ["left", "l"]:
			side = "left"
		elif word in ["right", "r"]:
			side = "right"
		else:
			left.append(word)
	var own := "".join(left)
	var table := _MIDDLE if side.is_empty() else _SIDED
	for meaning: String in table:
		if own in table[meaning]:
			return side + meaning
	return "" if side.is_empty() else _finger_of(side, own)


static func _finger_of(side: String, own: String) -> String:
	var joint := RegEx.create_from_string(_FINGER).search(own)
	if joint == null:
		return ""
	var finger := "little" if joint.get_string(1).begins_with("pink") else joint.get_string(1)
	var parts := ["metacarpal", "proximal", "distal"] if finger == "thumb" else ["proximal", "intermediate", "distal"]
	var part: String = parts[joint.get_string(2).to_int() - 1] if joint.get_string(2) else joint.get_string(3)
	return side + finger.capitalize() + part.capitalize()


## Return the words of a name in lower case, without its namespace: "mixamorig:LeftUpLeg" has left, up and leg.
static func _words(bone: String) -> PackedStringArray:
	var own := bone.get_slice(":", bone.get_slice_count(":") - 1).get_slice("|", bone.get_slice_count("|") - 1)
	var words := PackedStringArray()
	var word := ""
	var before := ""
	for letter in own:
		var is_upper := letter != letter.to_lower()
		var is_word := letter.to_lower() != letter.to_upper() or letter.is_valid_int()
		if word and (not is_word or (is_upper and before == before.to_lower())):
			words.append(word)
			word = ""
		if is_word:
			word += letter.to_lower()
		before = letter
	if word:
		words.append(word)
	return words
