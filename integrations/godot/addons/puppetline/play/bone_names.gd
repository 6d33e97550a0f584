extends RefCounted
## Recognises the bones of a humanoid by their names in other programs, as capture/bone_names.py does.

const BoneTable := preload("bone_table.gd")

const _PHALANGES: Array[String] = ["metacarpal", "proximal", "intermediate", "distal"]
const _SIDES: Dictionary = {"l": "left", "left": "left", "r": "right", "right": "right"}

var _table: Dictionary = JSON.parse_string(BoneTable.JSON_TEXT)
var _words: Dictionary = _by_word(_table["words"])
var _fingers: Dictionary = _by_word(_table["fingers"])
var _decoration: PackedStringArray = _table["decoration"].split(" ")
var _controls: PackedStringArray = _table["controls"].split(" ")
var _middle: PackedStringArray = _table["middle"].split(" ")
var _sided: PackedStringArray = _table["sides"].split(" ")
var _word := RegEx.create_from_string("[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^ -~]+")
var _glued: Array[RegEx] = [
	RegEx.create_from_string("^(?<side>left|right|l|r)(?<own>.+)$"),
	RegEx.create_from_string("^(?<own>.+?)(?<side>left|right|l|r)$"),
]
var _finger := RegEx.create_from_string(
	(
		"^(?:hand|finger|f)?(%s)(?:finger)?(?:[.]?([0-9]*)|(%s))$"
		% ["|".join(PackedStringArray(_fingers.keys())), "|".join(PackedStringArray(_PHALANGES))]
	)
)


## Return the bone of a skeleton for each joint of a service that is recognised, by the joint's name.
static func recognised(skeleton: Skeleton3D, joints: PackedStringArray) -> Dictionary:
	var bones := PackedStringArray()
	for bone in skeleton.get_bone_count():
		bones.append(skeleton.get_bone_name(bone))
	var meant: Dictionary = new().find_bones(bones)
	var found: Dictionary = {}
	for joint in joints:
		if joint in meant:
			found[joint] = bones[meant[joint]]
	for joint in joints:
		if joint in bones and joint not in found and joint not in found.values():
			found[joint] = joint
	return found


## Return the index of the name of each bone of VRM's humanoid, by VRM's names; parents stand before their children.
func find_bones(names: PackedStringArray) -> Dictionary:
	var joints: Dictionary = {}
	var fingers: Dictionary = {}
	var own := _own_words(names)
	var convention := _convention_of(own)
	for index in own.size():
		var meaning := _meaning_of(own[index], convention)
		if meaning.has("order"):
			fingers.get_or_add(own[index]["side"] + " " + meaning["part"], []).append([meaning["order"], index])
		elif meaning:
			joints.get_or_add(own[index]["side"] + meaning["part"], []).append(index)
	var found: Dictionary = {}
	for side: String in ["", "left", "right"]:
		_add_limbs(found, joints, side)
	for key: String in fingers:
		fingers[key].sort()
		var missing := "intermediate" if key.ends_with("thumb") else "metacarpal"
		for phalanx in _PHALANGES:
			if phalanx != missing and fingers[key]:
				found[key.get_slice(" ", 0) + (key.get_slice(" ", 1) + " " + phalanx).to_pascal_case()] = (
					fingers[key].pop_front()[1]
				)
	return found


## Add the bones of a side, or of the middle. The upper arm is the last shoulder if no joint is named after it.
func _add_limbs(found: Dictionary, joints: Dictionary, side: String) -> void:
	if joints.has(side + "lowerArm") and not joints.has(side + "upperArm") and joints.has(side + "shoulder"):
		joints[side + "upperArm"] = [joints[side + "shoulder"].pop_back()]
	var parts := _sided if side else _middle
	var own: Dictionary = {}
	for part in parts:
		if joints.get(side + part, []):
			own[part] = joints[side + part].pop_front()
	for part in parts:
		for other: String in _table["substitutes"].get(part, "").split(" "):
			if not own.has(part) and joints.get(side + other, []):
				own[part] = joints[side + other].pop_front()
	for part: String in own:
		found[side + part[0].to_upper() + part.substr(1) if side else part] = own[part]


## Return the side and the words of each name.
func _own_words(names: PackedStringArray) -> Array[Dictionary]:
	var split: Array[PackedStringArray] = []
	for name in names:
		split.append(_words_of(name))
	while _drop_shared_word(split, true) or _drop_shared_word(split, false):
		pass
	var own: Array[Dictionary] = []
	for words in split:
		var left := PackedStringArray()
		for word in words:
			if word not in _decoration:
				left.append(word)
		own.append(_without_side(left))
	return own


## Drop the first or last word of names that (nearly) all joints share, and no part is. Return whether there was one.
func _drop_shared_word(split: Array[PackedStringArray], is_first: bool) -> bool:
	var counts: Dictionary = {}
	var named := 0
	for words in split:
		if words:
			var word := words[0 if is_first else words.size() - 1]
			counts[word] = counts.get(word, 0) + 1
			named += 1
	var least: float = _table["sharedWordShare"] * maxf(named, _table["minSharingJoints"])
	for shared: String in counts:
		if counts[shared] >= least and shared not in _words and shared not in _SIDES:
			for index in split.size():
				var words := split[index]
				var place := 0 if is_first else words.size() - 1
				if words and words[place] == shared:
					words.remove_at(place)
					split[index] = words
			return true
	return false


## Return the words of a name in lower case, without its namespace; a point is before each number.
func _words_of(name: String) -> PackedStringArray:
	var words := PackedStringArray()
	if name.begins_with("__"):
		return words
	var own := name.get_slice(":", name.get_slice_count(":") - 1)
	own = own.get_slice("|", own.get_slice_count("|") - 1).replace("左", " left ").replace("右", " right ")
	for digit in 10:
		own = own.replace("０１２３４５６７８９"[digit], str(digit))
	for found in _word.search_all(own):
		var word := found.get_string()
		words.append("." + word if word.is_valid_int() else word.to_lower())
	return words


## Return the side in words, and the other words; a side may be at the beginning or end of a word.
func _without_side(words: PackedStringArray) -> Dictionary:
	var side := ""
	var left := PackedStringArray()
	for word in words:
		if word not in _SIDES:
			left.append(word)
		elif side.is_empty():
			side = _SIDES[word]
	var key := "".join(words)
	if side.is_empty() and not _is_known(key):
		for pattern in _glued:
			var found := pattern.search(key)
			if found != null and _is_known(found.get_string("own")):
				return {"side": _SIDES[found.get_string("side")], "key": found.get_string("own"), "words": []}
	return {"side": side, "key": "".join(left), "words": left}


## Return parts by the names of the convention that explains most joints; none if a skeleton has few names of it.
func _convention_of(names: Array[Dictionary]) -> Dictionary:
	var best: Dictionary = {}
	var most := 0
	for convention: Dictionary in _table["conventions"]:
		var parts: Dictionary = {}
		for rows: Array in [["", _middle, convention["middle"]], ["*", _sided, convention["sides"]]]:
			for k in rows[1].size():
				parts[rows[0] + rows[2].get_slice(" ", k)] = rows[1][k]
		var explained: Dictionary = {}
		for name in names:
			if _key_of(name) in parts:
				explained[name["side"] + _key_of(name)] = true
		if explained.size() > most and explained.size() >= convention["least"]:
			best = parts
			most = explained.size()
	return best


## Return the part of a joint, and the number of a finger's joint from the palm; nothing if the name is unknown.
func _meaning_of(name: Dictionary, convention: Dictionary) -> Dictionary:
	var known: String = convention.get(_key_of(name), _words.get(_without_digits(name["key"]), ""))
	if known:
		return {"part": known}
	for word: String in name["words"]:
		if word in _controls:
			return {}
	var finger: RegExMatch = _finger.search(name["key"]) if name["side"] else null
	if finger == null:
		return {}
	var stem := finger.get_string(1)
	var phalanx := finger.get_string(3)
	if phalanx == "metacarpal" and _fingers[stem] != "thumb":
		return {}
	if phalanx:
		return {"part": _fingers[stem], "order": _PHALANGES.find(phalanx)}
	var digits := finger.get_string(2)
	return {"part": _fingers[stem], "order": digits.to_int()} if digits or stem.right(1).is_valid_int() else {}


func _is_known(key: String) -> bool:
	return _without_digits(key) in _words or _finger.search(key) != null


static func _key_of(name: Dictionary) -> String:
	return ("*" if name["side"] else "") + name["key"]


static func _without_digits(key: String) -> String:
	for letter in ".0123456789":
		key = key.replace(letter, "")
	return key


static func _by_word(table: Dictionary) -> Dictionary:
	var found: Dictionary = {}
	for key: String in table:
		for word: String in table[key].split(" "):
			found[word] = key
	return found
