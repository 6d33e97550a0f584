@tool
extends RefCounted
## Functions that read values from an untrusted reply. A value that is missing or has another type is read as empty.

## Default maximum number of items that are read from a list.
const MAX_ITEMS := 256


static func table(from: Variant, key: String) -> Dictionary:
	var value: Variant = from.get(key) if from is Dictionary else null
	return value if value is Dictionary else {}


static func tables(from: Variant, key: String, limit: int) -> Array[Dictionary]:
	var found: Array[Dictionary] = []
	for each: Variant in _list(from, key, limit):
		if each is Dictionary:
			found.append(each)
	return found


static func text(from: Variant, key: String) -> String:
	var value: Variant = from.get(key) if from is Dictionary else null
	return value if value is String else ""


static func texts(from: Variant, key: String, limit: int) -> PackedStringArray:
	var found := PackedStringArray()
	for each: Variant in _list(from, key, limit):
		if each is String:
			found.append(each)
	return found


## Return a number, or [param default] if there is none.
static func number(from: Variant, key: String, default: float) -> float:
	var value: Variant = from.get(key) if from is Dictionary else null
	return value if value is float and is_finite(value) else default


static func flag(from: Variant, key: String) -> bool:
	var value: Variant = from.get(key) if from is Dictionary else null
	return value if value is bool else false


static func _list(from: Variant, key: String, limit: int) -> Array:
	var value: Variant = from.get(key) if from is Dictionary else null
	return value.slice(0, limit) if value is Array else []
